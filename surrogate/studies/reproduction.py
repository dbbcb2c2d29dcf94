"""All studies of a scale, one after the other, and the report on them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from shared_schema.errors import InputError
from surrogate.studies.catalogue import STUDIES
from surrogate.studies.report import write_report
from surrogate.studies.study import Study, do, is_done
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


def reproduce(studies: Sequence[Study], workshop: Workshop, out: Path) -> int:
    """Do the studies that are not done yet, and write the report on all that are.

    Parameters
    ----------
    studies : sequence of Study
    workshop : Workshop
    out : Path
        Folder of the records, figures and report; made if it is not there.

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
        if is_done(study, workshop, out):
            print(f"{here}: up to date", file=sys.stderr, flush=True)
            continue
        print(f"{here}: {study.title}", file=sys.stderr, flush=True)
        record = do(study, workshop, out)
        write_report(workshop.scale, STUDIES, out)
        done += 1
        print(f"{here}: {record.minutes:.1f} min", file=sys.stderr, flush=True)
    if done == 0:
        write_report(workshop.scale, STUDIES, out)
    return done
