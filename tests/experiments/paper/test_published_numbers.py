from __future__ import annotations

import pytest

from experiments.__main__ import main
from experiments.paper.published_numbers import PAPER
from surrogate.learning.evaluation.run_report import Published


def test_numbers_of_tables_and_figures() -> None:
    """Tables 1 to 8 and Figures 1 to 21, of which the first three explain the method."""
    assert (len(PAPER.tables), len(PAPER.figures)) == (8, 21)
    assert PAPER.title_of("const_channel") == "Table 8"
    assert PAPER.title_of("fig: MLEvsBayes") == "Figure 21"
    assert PAPER.figures[PAPER.method_figures] == "fig: three benchmark examples schematics"


def test_networks() -> None:
    """Tables "det_metrics" and "bayesian_table": ē in mm; of the 3D beam no Bayesian network."""
    means = {
        (case, likelihood): network.mean_error_mm
        for case, networks in PAPER.networks.items()
        for likelihood, network in networks.items()
    }
    assert means == {
        ("beam2d", "deterministic"): 0.3,
        ("beam2d", "variational_bayes"): 1.3,
        ("lshape2d", "deterministic"): 0.8,
        ("lshape2d", "variational_bayes"): 5.3,
        ("beam3d", "deterministic"): 0.6,
    }
    assert PAPER.network("beam3d", "variational_bayes") is None
    assert PAPER.network("my_case", "deterministic") is None


def test_the_first_example_is_the_one_at_the_tip() -> None:
    beam3d, bayesian = PAPER.networks["beam3d"]["deterministic"], PAPER.networks["beam2d"]
    assert beam3d.example is not None
    assert beam3d.example.tip_displacement_m == 1.1
    assert bayesian["variational_bayes"].example is None


def test_numbers_beside_those_of_a_run() -> None:
    """Table "det_metrics", 2D beam: ē = 0.3e-3 m, σ(e) = 0.2e-3 m, shown where it moves 0.95 m."""
    beam = PAPER.published("beam2d", "deterministic")
    assert beam.example_displacement == 0.95
    assert beam.numbers == {
        "mean error ē [10⁻³ m]": "0.3",
        "standard deviation σ(e) [10⁻³ m]": "0.2",
        "slope of e_m over displacement": "0.0008",
        "relative tip error, the example below": "0.6% at 0.95 m",
        "trainable parameters": "7.5 M",
        "training time": "131 min, one V100",
    }
    assert PAPER.published("bracket", "deterministic") == Published()


def test_nothing_is_published_of_a_case_that_the_paper_does_not_have(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["published", "beam2d_any"]) == 0
    assert capsys.readouterr().out == "{}\n"
