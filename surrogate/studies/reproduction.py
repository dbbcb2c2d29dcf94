"""All studies of a scale, one after the other, and the report on them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from shared_schema.common.errors import InputError
from surrogate.studies.catalogue import STUDIES
from surrogate.studies.report import write_report
from surrogate.studies.study import Study, current_record, do
from surrogate.studies.workshop import Workshop


def find_studies(names: Sequence[str]) -> list[Study]:
    """Studies by their names, in the order of the report.

    Raises
    ------
    InputError
        If there is none of a name.
    """
    known = {study.name: study for study in STUDIES}
    for name in names:
        if name not in known:
            raise InputError(f"study '{name}': expected one of {', '.join(known)}")
    return [study for study in STUDIES if study.name in names]


def reproduce(studies: Sequence[Study], workshop: Workshop, out: Path, again: bool = False) -> int:
    """Do the studies that are not done yet, and write the report on all that are.

    Parameters
    ----------
    studies : sequence of Study
    workshop : Workshop
    out : Path
        Folder of the records, figures and report; made if it is not there.
    again : bool
        Whether to do those as well that are done, as after a change of their code.

    Returns
    -------
    int
        How many were done now.

    Raises
    ------
    InputError
        If a dataset is missing; what was done before is kept.
    """
    for study in studies:  # before any work
        study.fingerprint(workshop)
    out.mkdir(parents=True, exist_ok=True)
    done = 0
    for number, study in enumerate(studies, 1):
        here = f"surrogate study {study.name} ({number} of {len(studies)})"
        if not again and current_record(study, workshop, out):
            print(f"{here}: up to date", file=sys.stderr, flush=True)
            continue
        print(f"{here}: {study.title}", file=sys.stderr, flush=True)
        record = do(study, workshop, out)
        report(workshop, out)
        done += 1
        print(f"{here}: {record.minutes:.1f} min", file=sys.stderr, flush=True)
    if done == 0:
        report(workshop, out)
    return done


def report(workshop: Workshop, out: Path) -> None:
    """Write the report on all studies that are done."""
    records = {study.name: current_record(study, workshop, out) for study in STUDIES}
    write_report(workshop.scale, STUDIES, records, out)
