"""Numbers that the paper reports (Deshpande, Lengiewicz, Bordas, CMAME 2022), from `paper.yaml`."""

from __future__ import annotations

from pathlib import Path

import yaml
from pydantic import Field

from shared_schema.common import Frozen, read_yaml, validate
from surrogate import Published

SOURCE = Path(__file__).with_name("paper.yaml")
CITATION = (
    "Paper: Deshpande, Lengiewicz, Bordas, “Probabilistic deep learning for real-time large "
    "deformation simulations”, CMAME 2022."
)
Number = int | float  # whole numbers stay whole


class PaperDataset(Frozen):
    """Mesh, forces and size of a dataset.

    Attributes
    ----------
    dofs, padded_dofs : int
        Degrees of freedom of the mesh, and components on its zero-padded grid.
    force_range_newton : tuple of float
        Range of a force component.
    training_samples, test_samples : int
        N and M.
    """

    dofs: int
    padded_dofs: int
    force_range_newton: tuple[Number, Number]
    training_samples: int
    test_samples: int


class PaperErrors(Frozen):
    """Errors ē and σ(e) on a test split."""

    mean_error_mm: Number
    std_error_mm: Number


class PaperExample(Frozen):
    """A sample that the paper shows, and the relative error of its predicted tip displacement."""

    tip_displacement_m: Number
    relative_tip_error: Number


class PaperNetwork(PaperErrors):
    """Results of the U-Net of one case and likelihood.

    Attributes
    ----------
    slope : float
        Slope of the regression line of e_m over the displacement magnitude.
    training_minutes : float
        Duration of the training.
    epochs : int
        Number of epochs of the training.
    parameters : float
        Number of trainable parameters.
    examples : dict of str to PaperExample
        Samples shown with their numbers, by the place of the load, the tip first.
    """

    slope: Number
    training_minutes: Number
    epochs: int
    parameters: Number
    examples: dict[str, PaperExample] = Field(default_factory=dict)

    def numbers(self, hardware: str) -> dict[str, str]:
        """Numbers by the name of their row in a run's report."""
        numbers = {
            "mean error ē [10⁻³ m]": f"{self.mean_error_mm:.1f}",
            "standard deviation σ(e) [10⁻³ m]": f"{self.std_error_mm:.1f}",
            "slope of e_m over displacement": f"{self.slope}",
            "trainable parameters": f"{self.parameters / 1e6:.1f} M",
            "training time": f"{self.training_minutes:.0f} min, {hardware}",
        }
        if self.example:
            shown = f"{self.example.relative_tip_error:.1%} at {self.example.tip_displacement_m} m"
            numbers["relative tip error, the example below"] = shown
        return numbers

    @property
    def example(self) -> PaperExample | None:
        """The sample that is loaded nearest to the tip, if the paper shows one."""
        return next(iter(self.examples.values()), None)


class PaperLinearNetwork(PaperErrors):
    """Errors of one dense layer, and the case that it was trained on."""

    case: str


class PaperChannels(PaperErrors):
    """Results of a U-Net with the same number of channels at every level."""

    training_minutes: Number
    prediction_ms: Number


class PaperTimes(Frozen):
    """Times of one solution and of one prediction."""

    finite_elements_ms: Number
    cpu_ms: Number
    gpu_ms: Number


class PaperBayesianPrediction(Frozen):
    """Number of stochastic passes of a Bayesian prediction, and the time of all of them."""

    passes: int
    all_passes_ms: Number


class PaperNoise(Frozen):
    """Noise of the noisy datasets: u → (1 + γ) u with γ ~ U(−amplitude, amplitude).

    Attributes
    ----------
    amplitude : float
        Largest relative change of a displacement.
    largest_force_newton : float
        Samples under larger forces ‖f‖₂ have no noise.
    sweep_end_newton : float
        Largest force that networks trained on noisy data are asked for.
    """

    amplitude: Number
    largest_force_newton: Number
    sweep_end_newton: Number


class Paper(Frozen):
    """Numbers of the paper; `paper.yaml` names the table or figure of each.

    Attributes
    ----------
    tables, figures : tuple of str
        Labels in the paper's source, in order.
    method_figures : int
        Number of figures, from the first on, that explain the method and show no result.
    hardware, training_loss : str
        Hardware and loss of the training.
    datasets : dict of str to PaperDataset
        Datasets by their names here.
    networks : dict of str to dict of str to PaperNetwork
        U-Nets by case and likelihood.
    linear_network : PaperLinearNetwork
        One dense layer that starts at K⁻¹.
    node_orders : dict of str to PaperErrors
        Errors of the 3D beam by the order of the nodes on the grid.
    constant_channels : dict of int to PaperChannels
        U-Nets of the 3D beam by their number of channels.
    best_channels, overfitting_channels : int
        Numbers of channels that the paper finds best, and too large.
    training_speed_up : float
        Training time of the standard U-Net over that with the best number of channels.
    prediction_times : dict of str to PaperTimes
        Times by case.
    real_time_ms : float
        Limit of the time of a prediction on a GPU.
    bayesian_prediction : PaperBayesianPrediction
        Time of all stochastic passes.
    multiple_loads : PaperExample
        The example under several loads.
    force_beyond_training_newton : float
        Force of the example outside the training range.
    noise : PaperNoise
        Noise of the noisy datasets.
    """

    tables: tuple[str, ...]
    figures: tuple[str, ...]
    method_figures: int
    hardware: str
    training_loss: str
    datasets: dict[str, PaperDataset]
    networks: dict[str, dict[str, PaperNetwork]]
    linear_network: PaperLinearNetwork
    node_orders: dict[str, PaperErrors]
    constant_channels: dict[int, PaperChannels]
    best_channels: int
    overfitting_channels: int
    training_speed_up: Number
    prediction_times: dict[str, PaperTimes]
    real_time_ms: Number
    bayesian_prediction: PaperBayesianPrediction
    multiple_loads: PaperExample
    force_beyond_training_newton: Number
    noise: PaperNoise

    def network(self, case: str, likelihood: str) -> PaperNetwork | None:
        """Results of the U-Net of a case and likelihood, if the paper has one."""
        return self.networks.get(case, {}).get(likelihood)

    def title_of(self, label: str) -> str:
        """Number of a table or figure by its label, such as "Table 4"."""
        if label in self.tables:
            return f"Table {self.tables.index(label) + 1}"
        return f"Figure {self.figures.index(label) + 1}"

    def published(self, case: str, likelihood: str) -> Published:
        """Numbers of a network in the form that `surrogate report` shows beside those of a run."""
        network = self.network(case, likelihood)
        if network is None:
            return Published()
        return Published(
            heading="paper",
            source=CITATION,
            example_displacement=network.example.tip_displacement_m if network.example else None,
            numbers=network.numbers(self.hardware),
        )


PAPER = validate(Paper, read_yaml(SOURCE), str(SOURCE))


def as_yaml(published: Published) -> str:
    """Write numbers as the commands' option ``--beside`` reads them."""
    content = published.model_dump(exclude_defaults=True)
    return str(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
