"""Start-up: processor time of the command line and of the first use of each public name, relative to `import numpy`.

Each process is started anew, turn and turn about with ``python -c "import numpy"``; the figures are medians.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from statistics import median

import structsel as ss

NUMPY = ("-c", "import numpy")


def processor_time(arguments: tuple[str, ...]) -> float:
    """User and system seconds of a new Python process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def jobs(names: list[str]) -> dict[str, tuple[str, ...]]:
    """Arguments of Python for each start."""
    program = "import sys; from structsel.cli import main; sys.argv[0] = 'structsel'; main()"
    return {
        "structsel --version": ("-c", program, "--version"),
        "structsel --help": ("-c", program, "--help"),
        "import structsel": ("-c", "import structsel"),
        **{f"structsel.{name}": ("-c", f"import structsel; structsel.{name}") for name in names},
    }


def ratios(wanted: dict[str, tuple[str, ...]], repeats: int) -> tuple[float, dict[str, tuple[float, float]]]:
    """Seconds of numpy; and of each job the seconds, and the median ratio to numpy within one round."""
    floor: list[float] = []
    times: dict[str, list[float]] = {name: [] for name in wanted}
    for _ in range(repeats):
        floor.append(processor_time(NUMPY))
        for name, arguments in wanted.items():
            times[name].append(processor_time(arguments))
    found = {name: (median(t), median(x / f for x, f in zip(t, floor))) for name, t in times.items()}
    return median(floor), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--names", default="Recording,read_recording,reconstruct,select,validate,simulate,refine,diagnose"
    )
    options = parser.parse_args()
    names = list(ss.__all__) if options.names == "all" else options.names.split(",")
    floor, found = ratios(jobs(names), options.repeats)
    print(f"| start | CPU seconds | relative to `import numpy` ({floor:.2f} s) |\n| --- | ---: | ---: |")
    for name, (seconds, ratio) in found.items():
        print(f"| `{name}` | {seconds:.2f} | {ratio:.1f} |")


if __name__ == "__main__":
    main()
