from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from shared_schema.common.errors import InputError
from shared_schema.manifest import read_manifest, write_manifest
from surrogate.learning.evaluation.run_report import Published, write_report

PUBLISHED = Published(
    heading="theirs",
    source="A. Author, Title, 2022.",
    numbers={"mean error ē [10⁻³ m]": "0.3", "trainable parameters": "7.5 M"},
)


@pytest.fixture(scope="module")
def page(evaluated: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(evaluated, path, nodal=data.parent / "nodal", published=PUBLISHED)
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]
    return path.read_text(encoding="utf-8")


def test_page_is_self_contained(page: str, evaluated: Path) -> None:
    sources = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", page)
    assert len(sources) == 5
    names = ("deformed", "error_field", "errors", "von_mises", "loss")
    for source, name in zip(sources, names, strict=True):
        prefix, _, text = source.partition(",")
        assert prefix == "data:image/png;base64"
        assert base64.b64decode(text) == (evaluated / "figures" / f"{name}.png").read_bytes()
    for remote in ("http:", "https:", "file:", "url(", "@import", "<script", "<link", "<iframe"):
        assert remote not in page


def test_page_holds_our_numbers_and_the_published(page: str, evaluated: Path) -> None:
    test = json.loads((evaluated / "evaluation.json").read_text())["test"]
    rows = {
        cells[0]: cells[1:]
        for row in re.findall(r"<tr>(.*?)</tr>", page)
        if (cells := re.findall(r"<td>(.*?)</td>", row))
    }
    assert rows["mean error ē [10⁻³ m]"] == [f"{test['mean_error'] * 1e3:.3f}", "0.3"]
    assert rows["standard deviation σ(e) [10⁻³ m]"] == [f"{test['std_error'] * 1e3:.3f}", "–"]
    assert rows["trainable parameters"][1] == "7.5 M"
    assert rows["test samples M"] == ["12", "–"]
    assert "<th>theirs</th>" in page
    assert "A. Author, Title, 2022." in page


def test_numbers_of_another_run_stand_beside(evaluated: Path, tmp_path: Path) -> None:
    """A committed record, whose mean error is 6.08332e-5 m."""
    record = Path(__file__).parents[4] / "docs/results/beam2d-det-fast.json"
    write_report(evaluated, tmp_path / "a.html", published=PUBLISHED, against=record)
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<th>here</th><th>theirs</th><th>beam2d-det-fast</th>" in page
    row = re.search(r"<tr><td>mean error ē.*?</tr>", page)
    assert row is not None
    assert re.findall(r"<td>(.*?)</td>", row[0])[2:] == ["0.3", "0.061"]


@pytest.mark.parametrize(
    ("content", "said"), [("[]", "a mapping"), ("{}", "'test'"), (None, "damaged")]
)
def test_what_is_no_evaluation_of_another_run_is_refused(
    evaluated: Path, tmp_path: Path, content: str | None, said: str
) -> None:
    other = tmp_path / "other.json"
    if content is not None:
        other.write_text(content)
    with pytest.raises(InputError, match=rf"other\.json: .*{said}"):
        write_report(evaluated, tmp_path / "a.html", against=other)
    assert not (tmp_path / "a.html").exists()


def test_published_numbers_without_a_row_are_refused(evaluated: Path, tmp_path: Path) -> None:
    published = Published(numbers={"weight": "3 kg"})
    with pytest.raises(InputError, match="published number 'weight': expected one of mean error"):
        write_report(evaluated, tmp_path / "a.html", published=published)
    assert not (tmp_path / "a.html").exists()


def test_without_published_numbers_there_is_no_column_of_them(
    evaluated: Path, tmp_path: Path
) -> None:
    write_report(evaluated, tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    table = page.partition("<tbody>")[2].partition("</tbody>")[0]
    assert table.count("<tr>") * 2 == table.count("<td>")
    assert "–</td>" not in table
    assert "published" not in page.lower().partition("<pre>")[0]


def test_page_says_how_it_was_made(page: str) -> None:
    """60 samples of 0.5 s each in the synthetic nodal dataset."""
    text = " ".join(page.split())
    assert "60 solved, 0 failed, 30.0 core seconds (500.00 ms each)" in text
    assert "Grid 8 × 4, d = 2; 48 training and 12 test samples" in text


def test_markup_in_the_data_is_escaped(
    evaluated: Path, tmp_path: Path, make_dataset: Callable[..., Path]
) -> None:
    """A case name, a path, a version and a machine's name with markup in them."""
    script, image = "<script>alert('&')</script>", '"><img src=x onerror=alert(1)>.msh'
    nodal = make_dataset(tmp_path).parent / "nodal"
    manifest = read_manifest(nodal, "nodal")
    changed = manifest.model_copy(update={"software": {"dolfinx": script, "petsc": "3"}})
    digest = write_manifest(nodal, changed).digest
    run = tmp_path / "run"
    shutil.copytree(evaluated, run)
    (run / "manifest.json").unlink()
    content = yaml.safe_load((run / "config.yaml").read_text())
    content["run"]["case"] = script
    content["data"]["case"]["mesh"] = {"kind": "file", "path": image}
    content["data"]["info"]["source_digest"] = digest
    (run / "config.yaml").write_text(yaml.safe_dump(content))
    evaluation = json.loads((run / "evaluation.json").read_text())
    (run / "evaluation.json").write_text(json.dumps({**evaluation, "machine": script}))
    (run / "hardware.txt").write_text(script)
    write_report(run, tmp_path / "a.html", nodal=nodal)
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page.count("&lt;script&gt;alert(&#39;&amp;&#39;)&lt;/script&gt;") == 8
    assert "&gt;&lt;img src=x onerror=alert(1)&gt;.msh" in page
    assert "<script" not in page
    assert "<img src=x" not in page


def test_report_is_in_the_units_of_the_case(evaluated: Path, tmp_path: Path) -> None:
    """Errors of 2.5e-7 mm are no zeros; the stress of mm and N is MPa."""
    run = tmp_path / "run"
    shutil.copytree(evaluated, run)
    (run / "manifest.json").unlink()
    content = yaml.safe_load((run / "config.yaml").read_text())
    content["data"]["case"]["units"] = {"length": "mm"}
    (run / "config.yaml").write_text(yaml.safe_dump(content))
    evaluation = json.loads((run / "evaluation.json").read_text())
    evaluation["test"] |= {"mean_error": 2.5e-7, "max_error": 0.125}
    evaluation["example"]["tip_displacement"] = 4e-6
    (run / "evaluation.json").write_text(json.dumps(evaluation))
    write_report(run, tmp_path / "a.html")
    page = " ".join((tmp_path / "a.html").read_text(encoding="utf-8").split())
    assert "solutions with a mean error ē = 0.25 nm" in page
    assert "<td>mean error ē [mm]</td><td>2.5e-07</td>" in page
    assert "<td>largest error of a component [mm]</td><td>0.12</td>" in page
    assert "at 4e-06 mm</td>" in page
    assert "mean error of von Mises stresses [MPa]" in page
    assert " m]" not in page


def test_hardware_of_the_training_and_of_the_evaluation(evaluated: Path, tmp_path: Path) -> None:
    """An unsealed run that was trained on one machine and evaluated on another."""
    run = tmp_path / "run"
    shutil.copytree(evaluated, run)
    (run / "manifest.json").unlink()
    (run / "hardware.txt").write_text("trainer, 7 threads\n")
    evaluation = json.loads((run / "evaluation.json").read_text())
    (run / "evaluation.json").write_text(json.dumps({**evaluation, "machine": "evaluator"}))
    write_report(run, tmp_path / "a.html")
    page = " ".join((tmp_path / "a.html").read_text(encoding="utf-8").split())
    assert re.search(r"<td>training time</td>\s*<td>\S+ min, trainer, 7 threads</td>", page)
    assert re.search(r"Training: 40 epochs, \d+ s on trainer, 7 threads, seed 0", page)
    assert "Evaluation: on evaluator, torch" in page


@pytest.mark.parametrize(
    "content",
    ["[]", "{}", "null", '{"test": 3}', '{"test": {"mean_error": "x"}, "example": {}}', "7" * 5000],
)
def test_other_json_in_the_evaluation_is_refused(
    evaluated: Path, tmp_path: Path, content: str
) -> None:
    run = tmp_path / "run"
    shutil.copytree(evaluated, run)
    (run / "evaluation.json").write_text(content)
    with pytest.raises(InputError, match=r"evaluation\.json: damaged, its checksum"):
        write_report(run, tmp_path / "a.html")
    (run / "manifest.json").unlink()
    with pytest.raises(InputError, match=r"evaluation\.json: (damaged|not measures of a run)"):
        write_report(run, tmp_path / "a.html")


def test_other_nodal_dataset(
    evaluated: Path, tmp_path: Path, make_dataset: Callable[..., Path]
) -> None:
    other = make_dataset(tmp_path / "other", seed=1).parent / "nodal"
    with pytest.raises(InputError, match="not the dataset that the run's data was made from"):
        write_report(evaluated, tmp_path / "a.html", nodal=other)
    assert not (tmp_path / "a.html").exists()
