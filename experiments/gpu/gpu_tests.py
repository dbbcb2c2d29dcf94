"""Step: the tests that are marked `gpu`."""

from __future__ import annotations

import signal
import subprocess
import sys
from xml.etree import ElementTree

from experiments.framework.experiment import Findings
from experiments.framework.machine import ROOT
from experiments.gpu.setting import GpuSetting, Results

CLOSING = 10.0  # s for what pytest says in the end
SMALL = "tests/surrogate/learning/training/test_precision.py"


def marked_files() -> list[str]:
    """Files with such tests: others may need packages that are not there."""
    files = sorted((ROOT / "tests" / "surrogate").rglob("test_*.py"))
    return [str(path.relative_to(ROOT)) for path in files if "mark.gpu" in path.read_text()]


def gpu_tests(setting: GpuSetting) -> Findings:
    """Run them; the log is `gpu-tests.log`."""
    report = setting.out / "gpu-tests.xml"
    command = [sys.executable, "-m", "pytest", "-m", "gpu", "-p", "no:cacheprovider", "-q"]
    command += [f"--junitxml={report.absolute()}", *([SMALL] if setting.small else marked_files())]
    with (setting.out / "gpu-tests.log").open("w") as log:
        tests = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT)
        ended: Results = {}
        try:
            tests.wait(max(1.0, setting.seconds_left - CLOSING))
        except subprocess.TimeoutExpired:
            tests.send_signal(signal.SIGINT)  # pytest then says what has failed
            tests.wait()
            ended = {"timed_out": True}
    if not report.is_file():
        return Findings(numbers={"command": command[1:], **ended})
    cases = list(ElementTree.parse(report).iter("testcase"))

    def named(*outcomes: str) -> list[str]:
        return [
            f"{case.get('classname')}.{case.get('name')}: {found.get('message', '')[:300]}"
            for case in cases
            for outcome in outcomes
            if (found := case.find(outcome)) is not None
        ]

    failed, skipped = named("failure", "error"), named("skipped")
    return Findings(
        numbers={
            "command": command[1:],
            "tests": len(cases),
            "passed": len(cases) - len(failed) - len(skipped),
            "failed": failed,
            "skipped": skipped,
            **ended,
        }
    )
