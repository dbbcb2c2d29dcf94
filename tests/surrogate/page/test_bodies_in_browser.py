"""Pages of every cell type and kind of network give what `surrogate predict` gives."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.training.loop import train
from surrogate.mechanics.statics.load import given_load
from surrogate.page.page import write_page
from tests.surrogate.learning.inference.test_export import embedded
from tests.surrogate.mechanics.bodies import as_simplices
from tests.surrogate.page.browser import OpenPage
from tests.surrogate.page.runs import LINEAR, untrained
from tests.surrogate.rollers import held_components

pytestmark = [pytest.mark.browser, pytest.mark.slow]

RELATIVE = 1e-4
RANDOM = {"variational": {"initial_std": 0.05}}
NETWORKS: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "hexahedra": ("3d", LINEAR, {}),
    "tetrahedra": ("3d simplices", LINEAR, {}),
    "triangles, embedded grid": ("2d simplices embedded", LINEAR, {}),
    "maximum likelihood": ("2d", {}, {"likelihood": "maximum_likelihood"}),
    "variational Bayes": ("2d", LINEAR, {"likelihood": "variational_bayes", **RANDOM}),
    "ensemble": ("2d", LINEAR, {"ensemble": 3}),
    "dropout": ("2d", {"dropout": 0.2}, {}),
}


def test_page_of_a_series_predicts_what_the_program_does(
    dataset_3d: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    """Terms, coefficients of the least energy, and the equilibrium, of a small and a large load."""
    data = replace(dataset_3d, geometry=as_simplices(dataset_3d.geometry))
    train({"model": "series", "series_order": 3}, data, tmp_path / "run")
    write_page(tmp_path / "run", tmp_path / "page.html")
    model = load(tmp_path / "run")
    page = open_page(tmp_path / "page.html")
    nodes = np.flatnonzero(model.geometry.loadable)
    for factor, before in ((0.1, 0.0), (30.0, 0.1)):
        page.load(int(nodes[-1]), 2.0 * factor, -3.0 * factor, 1.0 * factor)
        error, settled = page.certificate()
        plain = model.predict(page.forces)
        expected = model.solve(page.forces, tolerance=1e-4).displacement
        size = np.abs(expected).max()
        assert settled
        assert np.abs(plain - expected).max() >= before * size
        assert np.abs(page.field("displacement") - expected).max() < 1e-3 * size
        assert np.abs(error).max() < 1e-3 * size
    assert "--tolerance 0.0001 " in page.text("#panel code")


@pytest.mark.parametrize("kind", ["series", "network", "network, embedded grid"])
def test_patch_and_body_force(
    kind: str,
    dataset: Dataset,
    dataset_3d: Dataset,
    open_page: Callable[..., OpenPage],
    tmp_path: Path,
) -> None:
    """A dragged force is spread over the surface; the copied command means the same forces."""
    load_of_case = [
        {"family": "body_force", "range": [-0.3, 0.2]},
        {"family": "traction_patch", "range": [-2, 2], "radius": [0.5, 0.7]},
    ]
    data, run = dataset if "embedded" in kind else dataset_3d, tmp_path / "run"
    case, geometry = {**data.manifest.case, "load": load_of_case}, data.geometry
    data = replace(data, manifest=data.manifest.model_copy(update={"case": case}))
    if kind == "series":
        train({"model": "series", "series_order": 3}, data, run)
    else:
        geometry = embedded(geometry) if "embedded" in kind else geometry
        untrained(run, data, geometry, LINEAR)
    write_page(run, tmp_path / "page.html")
    model, page = load(run), open_page(tmp_path / "page.html")
    height, d = geometry.coordinates[:, -1], geometry.dimension
    top = np.flatnonzero(height == height.max())
    page.drag(int(top[geometry.coordinates[top, 0].argmax()]), right=25, up=40)
    page.page.locator("#body-force input[type=number]").nth(d - 1).fill("-0.15")
    page.settle()

    command = page.text("#panel code")
    texts = re.findall(r'--load="([^"]*)"', command)
    density = re.search(r'--body-force="([^"]*)"', command)
    assert density is not None
    assert [text.partition(":")[0].count(",") for text in texts] == [d]
    assert texts[0].split(":")[0].endswith(",0.6")
    assert density[1] == ",".join(["0"] * (d - 1) + ["-0.15"])
    forces = given_load(model.geometry, texts, body_force=density[1]).forces
    assert np.count_nonzero(forces.any(axis=1)) == np.count_nonzero(~geometry.clamped)
    np.testing.assert_allclose(page.forces, forces, atol=1e-12)
    if kind == "series":
        page.certificate()
        expected = model.solve(forces, tolerance=5e-3).displacement
    else:
        expected = model.averaged_passes(forces).mean
    found = page.field("displacement")
    assert np.abs(found - expected).max() < RELATIVE * np.abs(expected).max()


@pytest.mark.parametrize("name", NETWORKS)
def test_page_predicts_what_the_program_does(
    name: str,
    dataset: Dataset,
    dataset_3d: Dataset,
    open_page: Callable[..., OpenPage],
    tmp_path: Path,
) -> None:
    body, network, content = NETWORKS[name]
    data = dataset_3d if body.startswith("3d") else dataset
    geometry = as_simplices(data.geometry) if "simplices" in body else data.geometry
    if "embedded" in body:
        geometry = embedded(geometry)
    run = untrained(tmp_path / "run", data, geometry, network, **content)
    written = write_page(run, tmp_path / "page.html")
    model = load(run)

    page = open_page(tmp_path / "page.html")
    nodes = np.flatnonzero(model.geometry.loadable)
    page.drag(int(nodes[-1]), right=25, up=45)
    page.load(int(nodes[0]), *[0.7, -0.4, 0.3][: model.geometry.dimension])
    forces = page.forces
    assert set(np.flatnonzero(forces.any(axis=1))) == {nodes[0], nodes[-1]}

    passes = {} if written.passes is None else {"passes": written.passes}
    expected = model.averaged_passes(forces, **passes)
    fields = {"displacement": expected.mean}
    if model.is_probabilistic:
        fields |= {"std": expected.std}
    for field, values in fields.items():
        assert np.abs(values).max() > 0
        found = page.field(field)
        assert np.abs(found - values).max() < RELATIVE * np.abs(values).max(), field
    choices = page.page.evaluate("surrogatePage.state.choices")
    has = {kind for kind in ("epistemic", "aleatoric") if getattr(expected, f"std_{kind}").any()}
    assert set(choices) == {"displacement", "error", *has}
    assert written.passes == (30 if model.is_stochastic else None)


def test_labels_of_units_and_a_small_body(
    dataset: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    """A body of less than 1e-12 m has places; one in mm and kN has these labels, no prefixes."""
    small = replace(dataset.geometry, coordinates=1e-14 * dataset.geometry.coordinates)
    node = int(np.flatnonzero(small.loadable)[-1])
    for geometry, units in ((small, None), (dataset.geometry, {"length": "mm", "force": "kN"})):
        folder = tmp_path / ("labelled" if units else "small")
        folder.mkdir()
        run = untrained(folder / "run", dataset, geometry, LINEAR, units=units)
        write_page(run, folder / "page.html")
        page = open_page(folder / "page.html")
        page.load(node, 0.5, -0.25)
        text = page.text("#panel")
        if units is None:
            assert re.search(r"\(\S*e−1[345], ", text)
        else:
            assert "Fx in kN" in text
            assert re.search(r"\) mm", text)
            assert not re.search(r"\d [pnµmkM]?[mN]\b(?<! mm)", text)


@pytest.mark.parametrize("body", ["plane, embedded grid", "space"])
def test_page_of_a_body_on_rollers(
    body: str,
    dataset: Dataset,
    dataset_3d: Dataset,
    open_page: Callable[..., OpenPage],
    tmp_path: Path,
) -> None:
    """Single components are held: response and estimate are those of the program all the same."""
    data = dataset_3d if body == "space" else dataset
    held = held_components(data.geometry.dimension)
    geometry = replace(data.geometry, single=held, clamped=np.asarray(held.all(axis=1)))
    if "embedded" in body:
        geometry = embedded(geometry)
    run = untrained(tmp_path / "run", data, geometry, LINEAR)
    assert write_page(run, tmp_path / "page.html").estimates
    model = load(run)
    page = open_page(tmp_path / "page.html")
    page.load(int(np.flatnonzero(geometry.loadable)[-1]), *[0.5, -0.3, 0.4][: geometry.dimension])
    found, expected = page.field("displacement"), model.averaged_passes(page.forces).mean
    assert np.abs(found - expected).max() < RELATIVE * np.abs(expected).max()
    assert not found[held].any()
    assert np.abs(found[geometry.free]).max() > 0
    error, settled = page.certificate()
    certificate = model.certify(page.forces, found)
    assert settled == bool(certificate.settled)
    np.testing.assert_allclose(
        error, certificate.error, atol=1e-6 * float(np.max(certificate.max_error))
    )


def test_page_without_material_has_no_estimate(
    dataset: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    case = {key: value for key, value in dataset.manifest.case.items() if key != "material"}
    nameless = replace(dataset, manifest=dataset.manifest.model_copy(update={"case": case}))
    run = untrained(tmp_path / "run", nameless, dataset.geometry, {})
    assert_no_estimate(run, dataset, open_page, tmp_path / "page.html")


def test_page_of_other_elements_estimates(
    dataset: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    """The response and the estimate are those of cells that change their volume as a whole."""
    silicone = {**dataset.manifest.case["material"], "poisson_ratio": 0.49}
    case = {**dataset.manifest.case, "material": silicone, "element": "incompressible"}
    soft = replace(dataset, manifest=dataset.manifest.model_copy(update={"case": case}))
    run = untrained(tmp_path / "run", soft, dataset.geometry, LINEAR)
    assert write_page(run, tmp_path / "page.html").estimates
    model, page = load(run), open_page(tmp_path / "page.html")
    page.load(int(np.flatnonzero(dataset.geometry.loadable)[0]), 0.5, 0.5)
    found = page.field("displacement")
    expected = model.averaged_passes(page.forces).mean
    assert np.abs(found - expected).max() < RELATIVE * np.abs(expected).max()
    error, settled = page.certificate()
    certificate = model.certify(page.forces, found)
    assert settled == bool(certificate.settled)
    np.testing.assert_allclose(error, certificate.error, atol=1e-6 * float(certificate.max_error))


def test_pressure_on_two_materials_with_points_between_the_nodes(
    dataset: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    """A slider presses a side of incompressible triangles; the copied command means the same."""
    geometry = as_simplices(dataset.geometry)
    x = geometry.coordinates
    top = x[:, 1] == x[:, 1].max()
    facets = geometry.surface_facets
    rubber = {"model": "yeoh", "c10": 80, "c20": 30, "c30": 5, "bulk_modulus": 30000}
    material = {**dataset.manifest.case["material"], "group": "root"}
    geometry = replace(
        geometry,
        parts=(x[geometry.cells, 0].mean(axis=1) > x[:, 0].mean()).astype(np.int64),
        groups={"top": top},
        pressed=facets[top[facets].all(axis=1)],
        pressed_surface=np.zeros(top[facets].all(axis=1).sum(), dtype=np.int64),
    )
    case = {
        **dataset.manifest.case,
        "material": [material, {**rubber, "group": "end"}],
        "element": "incompressible",
        "load": [{"family": "pressure", "region": {"group": "top"}, "range": [0.0, 3.0]}],
    }
    data = replace(dataset, manifest=dataset.manifest.model_copy(update={"case": case}))
    run, path = tmp_path / "run", tmp_path / "page.html"
    train({"model": "series", "series_order": 4}, replace(data, geometry=geometry), run)
    assert write_page(run, path).estimates
    model, page = load(run), open_page(path)
    page.page.locator("#pressures input[type=number]").fill("1.5")
    page.load(int(np.flatnonzero(geometry.loadable)[-1]), 0.3, -0.5)
    error, settled = page.certificate()
    command = page.text("#panel code")
    loads = re.findall(r'--load="?([^" ]*)"?', command)
    assert loads[-1] == "top:1.5"
    expected = model.solve(loads)
    size = np.abs(expected.displacement).max()
    tight = model.solve(loads, correct=True).displacement
    assert settled
    assert np.abs(error).max() < 5e-3 * size
    assert np.abs(page.field("displacement") - tight).max() < 5e-3 * size
    assert np.abs(expected.displacement - model.solve(loads[:1]).displacement).max() > 0.05 * size
    np.testing.assert_allclose(page.forces, expected.force, atol=1e-6 * np.abs(page.forces).max())


def assert_no_estimate(
    run: Path, dataset: Dataset, open_page: Callable[..., OpenPage], path: Path
) -> None:
    """Assert that a page predicts what the program does, and offers no estimated error."""
    assert not write_page(run, path).estimates
    page = open_page(path)
    page.load(int(np.flatnonzero(dataset.geometry.loadable)[0]), 0.5, 0.5)
    expected = load(run).averaged_passes(page.forces).mean
    assert np.abs(page.field("displacement") - expected).max() < RELATIVE * np.abs(expected).max()
    assert page.page.evaluate("surrogatePage.state.choices") == ["displacement"]


def test_loads_unlike_those_of_the_training_are_warned_of(
    dataset: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    """The page warns where `TrainingRange.exceeded` does; one load a sample was trained on.

    A force beyond the range is told by a line, the stage and the load itself.
    """
    geometry = dataset.geometry
    run = untrained(tmp_path / "run", dataset, geometry, {})
    write_page(run, tmp_path / "page.html")
    model = load(run)
    page = open_page(tmp_path / "page.html")
    trained = [int(node) for node in np.flatnonzero(geometry.loadable)]
    elsewhere = np.flatnonzero(~geometry.loadable & ~geometry.clamped)

    def kinds() -> set[str]:
        found = set(page.page.evaluate("[...surrogatePage.state.warnings().keys()]"))
        assert found == set(model.training_range.exceeded(page.forces))
        return found

    page.load(trained[0], 0.5, 2.0)
    assert kinds() == set()
    page.load(trained[1], 0.5, 0.2)
    assert kinds() == {"number"}
    page.load(trained[1], 0.5, 2.0)
    assert kinds() == {"number", "resultant"}
    page.page.get_by_text("Remove all").click()
    lowest = int(elsewhere[geometry.coordinates[elsewhere].sum(axis=1).argmax()])
    page.drag(lowest, right=0, up=30)
    assert kinds() == {"places"}
    assert "never loaded in training" in page.text("#warnings")
    page.page.get_by_text("Remove all").click()
    limit = model.description.data.info.force.max_abs
    for factor, beyond in ((0.9, 0), (1.1, 1), (0.9, 0)):
        page.load(trained[-1], 0.0, factor * limit[1])
        text = page.text("#warnings")
        assert text.startswith("Force beyond the training range, ±") if beyond else text == ""
        assert page.page.locator("#stage.outside").count() == beyond
        assert page.page.locator(".load.beyond").count() == beyond
