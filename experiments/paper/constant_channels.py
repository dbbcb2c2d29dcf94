"""The same number of channels at every level of the U-Net (Table "const_channel")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import MARGIN, Cell, Claim, Table, compare
from experiments.framework.resources import Resources
from experiments.framework.scale import Scale
from experiments.measures.errors_on_test_split import MM, split_errors
from experiments.measures.latency import prediction_seconds
from experiments.paper.published_numbers import PAPER, PaperChannels, PaperNetwork
from surrogate import load
from surrogate.runtime.device import hardware

RUNS, STANDARD = "beam3d-c*", "beam3d-det"
BEST, TOO_MANY = PAPER.best_channels, PAPER.overfitting_channels


@dataclass(frozen=True)
class Network:
    """A row of the table.

    Attributes
    ----------
    mean, std : float
        Errors ē and σ(e) in mm.
    minutes : float
        Duration of the training.
    prediction : float or None
        Time of a prediction in ms.
    training_loss, validation_loss : float or None
        Scaled losses of the last epoch.
    """

    mean: float
    std: float
    minutes: float
    prediction: float | None = None
    training_loss: float | None = None
    validation_loss: float | None = None

    def cells(self) -> tuple[Cell, ...]:
        """Cells of the row."""
        losses = self.training_loss, self.validation_loss
        return self.mean, self.std, self.minutes, self.prediction, *losses


def from_paper(paper: PaperChannels | PaperNetwork) -> Network:
    """Row of a network of the paper; the standard U-Net has no prediction time in its table."""
    prediction = paper.prediction_ms if isinstance(paper, PaperChannels) else None
    return Network(paper.mean_error_mm, paper.std_error_mm, paper.training_minutes, prediction)


PAPER_NETWORKS = {c: from_paper(paper) for c, paper in PAPER.constant_channels.items()}
PAPER_STANDARD = from_paper(PAPER.networks["beam3d"]["deterministic"])


def measure_network(resources: Resources, run: str) -> Network:
    """Measure the row of a run."""
    errors, trained = split_errors(resources, run), resources.trained(run)
    surrogate = load(trained.folder, resources.device.type)
    force = resources.dataset_of(run).nodal_test.force[0]
    seconds = prediction_seconds(surrogate, force, timing=resources.scale.timing)
    last = trained.metric_lines()[-1]
    return Network(
        MM * errors.mean_error,
        MM * errors.std_error,
        resources.run_record(run).minutes,
        1e3 * seconds,
        last["train_loss"],
        last.get("validation_loss"),
    )


def standard_run(scale: Scale, runs: Mapping[int, str]) -> str | None:
    """Name of the run of the standard U-Net, if it is trained for as many epochs as c = 64.

    None at a scale whose 3D network has the same number of channels at every level.
    """
    if BEST not in runs or STANDARD not in scale.runs:
        return None
    standard = scale.unet_of(STANDARD)
    best = scale.unet_of(runs[BEST])
    as_long = standard.training.epochs == best.training.epochs
    return STANDARD if standard.network.multiplier > 1 and as_long else None


def measure(resources: Resources) -> Findings:
    """Measure errors, times and losses of all runs of the scale."""
    scale = resources.scale
    runs = {scale.unet_of(run).network.channels: run for run in scale.matching((RUNS,))}
    found = {channels: measure_network(resources, runs[channels]) for channels in sorted(runs)}
    rows: list[tuple[Cell, ...]] = []
    comparisons = []
    for channels, here in found.items():
        rows.append((channels, "here", *here.cells()))
        if channels in PAPER_NETWORKS:
            paper = PAPER_NETWORKS[channels]
            rows.append((channels, "paper", *paper.cells()))
            comparisons += [
                compare(f"c = {channels}: ē", "mm", here.mean, paper.mean),
                compare(f"c = {channels}: σ(e)", "mm", here.std, paper.std),
            ]
    run = standard_run(scale, runs)
    standard = measure_network(resources, run) if run is not None else None
    if standard is not None:
        rows += [("standard", "here", *standard.cells())]
        rows += [("standard", "paper", *PAPER_STANDARD.cells())]
    return Findings(
        [channels_table(rows, hardware(resources.device))], comparisons, claims_on(found, standard)
    )


def channels_table(rows: list[tuple[Cell, ...]], device: str) -> Table:
    """Table of the rows; `device` describes the device of the predictions."""
    return Table(
        caption="3D beam, deterministic U-Nets with c channels at every level (standard: doubling "
        f"from level to level); predictions here on {device}, in the paper on {PAPER.hardware}. "
        "Losses, scaled, of the last epoch: of a network that overfits, the validation loss is "
        "well above the training loss.",
        head=(
            "channels c",
            "",
            "ē [mm]",
            "σ(e) [mm]",
            "training [min]",
            "prediction [ms]",
            "training loss",
            "validation loss",
        ),
        rows=tuple(rows),
    )


def claims_on(found: Mapping[int, Network], standard: Network | None) -> list[Claim]:
    """Test the claims of the paper on networks by their number of channels, ascending."""
    claims = [more_is_better(found, standard)]
    if TOO_MANY in found and BEST in found:
        claims.append(overfits(found[TOO_MANY], found[BEST]))
    if standard is not None:
        claims.append(as_good_sooner(found[BEST], standard))
    return claims


def more_is_better(found: Mapping[int, Network], standard: Network | None) -> Claim:
    """Test whether the error falls with the number of channels, up to the paper's best."""
    up_to_best = {c: here.mean for c, here in found.items() if c <= BEST}
    missing = [f"c = {c}" for c in PAPER_NETWORKS if c not in found]
    if standard is None:
        missing.append("the standard U-Net for as many epochs")
    not_run = f" Of the paper's networks not run here: {', '.join(missing)}." if missing else ""
    return Claim(
        what=f"More channels make a smaller error, up to c = {max(up_to_best)}.",
        holds=all(fewer > more for fewer, more in pairwise(up_to_best.values())),
        evidence=f"{describe_errors(found)}; "
        f"the paper: {describe_errors(PAPER_NETWORKS)}.{not_run}",
    )


def describe_errors(networks: Mapping[int, Network]) -> str:
    """Write mean errors with their numbers of channels."""
    errors = ", ".join(f"{n.mean:.3g} mm (c = {c})" for c, n in networks.items())
    return f"ē = {errors}"


def overfits(many: Network, best: Network) -> Claim:
    """Test whether too many channels make the error larger again."""
    return Claim(
        what=f"c = {TOO_MANY} is worse than c = {BEST}: it overfits.",
        holds=many.mean > best.mean,
        evidence=f"ē = {many.mean:.3g} and {best.mean:.3g} mm; the paper: "
        f"{PAPER_NETWORKS[TOO_MANY].mean} and {PAPER_NETWORKS[BEST].mean} mm.",
        better=True,
    )


def as_good_sooner(best: Network, standard: Network) -> Claim:
    """Test whether constant channels match the standard U-Net after a third of its training."""
    least = PAPER.training_speed_up / MARGIN

    def describe(one: Network, other: Network) -> tuple[str, str]:
        return (
            f"{one.mean:.3g} and {other.mean:.3g} mm",
            f"{other.minutes / one.minutes:.2g} times shorter",
        )

    errors, times = describe(best, standard)
    papers = describe(PAPER_NETWORKS[BEST], PAPER_STANDARD)
    return Claim(
        what=f"c = {BEST} at every level has an error comparable to the standard U-Net's, after a "
        "third of its training time.",
        holds=best.mean <= MARGIN * standard.mean and standard.minutes >= least * best.minutes,
        evidence=f"ē = {errors} (comparable: ≤ {MARGIN:g} times), training {times} "
        f"(≥ {least:g}); the paper: {papers[0]}, {papers[1]}.",
    )


STUDY = Experiment(
    name="constant-channels",
    title="Number of channels",
    labels=("const_channel",),
    question="How many channels are enough, if every level of the U-Net has the same?",
    measure=measure,
    runs=(RUNS, STANDARD),
    times=True,
)
