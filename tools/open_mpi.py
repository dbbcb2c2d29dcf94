"""Settings of Open MPI 4 and 5 by variables; their options differ, and each ignores the other's.

They are those of the Makefile, for runs as root, with more ranks than cores, and without mpirun's
own words about programs that fail. Open MPI 5 has no way to leave these out: see
`without_launcher`.
"""

from __future__ import annotations

import re

SETTINGS = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_orte_execute_quiet": "1",
    "OMPI_MCA_reachable": "weighted",  # "netlink", Debian's first choice, warns of IPv6 addresses
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMP_NUM_THREADS": "1",
}
# Beginnings of the variables by which Open MPI tells a process to which run it belongs.
OF_A_RUN = ("OMPI_", "OPAL_", "ORTE_", "PMIX_", "PRTE_")
RULE = "-{60,}\n"
OWN_ERROR = r"\[[\w.-]+:\d+\] PMIX ERROR: .*\n"  # [host:process], as ranks end before mpirun


def without_launcher(said: str) -> str:
    """What a program said to stderr, without the remarks of Open MPI 5."""
    between_rules = re.sub(f"{RULE}.*?{RULE}", "", said, flags=re.DOTALL).strip("\0")
    return re.sub(OWN_ERROR, "", between_rules)
