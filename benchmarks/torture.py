"""Hostile input, faults and stress: nothing crashes, hangs, or is wrong without a word.

    python benchmarks/torture.py [--only readers,verbs,faults,stress] [--quick] [--seed 0] [--random 200] [--json FILE] [--markdown]

`readers`: every reader of a file gets files made by hand and sound files changed at random, in a process whose memory is bounded. `verbs`:
every verb of the command line on input that is unfit for it. `faults`: full disks, folders that cannot be written, processes that are
killed, missing libraries. `stress`: sizes, scales and shapes at the edge of what numbers can hold. Ends with 1 if anything failed.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from book import Sheet, Table, add_options

SECTIONS = ("readers", "verbs", "faults", "stress")
LONGEST_STRESS = 1800.0
"""Seconds for a verb on a million vertices."""
RANDOM, QUICK = 200, 20
"""Files changed at random for each reader; of a quick run."""


def readers(sheet: Sheet, chosen: argparse.Namespace) -> int:
    """A row for each reader."""
    from torture_pool import Tally, tried
    from torture_readers import READERS, laid

    rows, failures = [], []
    for reader in READERS.values():
        if chosen.reader and reader.name not in chosen.reader.split(","):
            continue
        tally = Tally()
        with tempfile.TemporaryDirectory() as folder:
            tasks = laid(reader, Path(folder, "a"), QUICK if chosen.quick else chosen.random, chosen.seed)
            for name, task, found in tried("torture_readers", tasks):
                tally.add(name, found)
                if chosen.verbose:
                    sys.stderr.write(
                        f"{reader.name:14s}{found.outcome:9s}{found.seconds:7.2f} {name} [{task['expect']}] {found.note[:200]}\n"
                    )
        rows.append([reader.name, *tally.row("refused", "read", "failed"), f"{tally.slowest:.2f}", f"{tally.megabytes:.0f}"])
        failures += [f"{reader.name}: {text}" for text in tally.failures]
    heads = ["reader", "files tried", "refused", "read", "failed", "slowest s", "most MB"]
    sheet.add(Table(f"Hostile files, seed {chosen.seed}", heads, rows, notes=failures))
    return len(failures)


def verbs(sheet: Sheet, chosen: argparse.Namespace) -> int:
    """A row for each verb."""
    from torture_pool import Tally, tried
    from torture_verbs import QUICK_VERBS, VERBS, laid

    rows, failures = [], []
    for verb in QUICK_VERBS if chosen.quick else VERBS:
        if chosen.verb and verb.split()[0] not in chosen.verb.split(","):
            continue
        tally = Tally()
        with tempfile.TemporaryDirectory() as folder:
            for name, _, found in tried("torture_verbs", laid(Path(folder, "a"), verb, chosen.quick)):
                tally.add(name, found)
                if chosen.verbose:
                    sys.stderr.write(f"{verb:20s}{found.outcome:9s}{found.seconds:7.2f} {name} {found.note[:300]}\n")
        rows.append([verb, *tally.row("refused", "repaired", "done", "failed"), f"{tally.slowest:.1f}", f"{tally.megabytes:.0f}"])
        failures += [f"{verb}: {text}" for text in tally.failures]
    heads = ["verb", "inputs tried", "refused", "mended or warned", "done", "failed", "slowest s", "most MB"]
    sheet.add(Table("Verbs on unfit input", heads, rows, notes=failures))
    return len(failures)


def faults(sheet: Sheet, chosen: argparse.Namespace) -> int:
    """A row for each fault."""
    from torture_faults import FAULTS, CannotBe
    from torture_pool import Tally

    rows, failures = [], []
    for name, happen in FAULTS.items():
        if chosen.fault and chosen.fault not in name:
            continue
        tally, began = Tally(), time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            try:
                for what, found in happen(Path(folder, "a"), chosen.quick):
                    tally.add(what, found)
                    if chosen.verbose:
                        sys.stderr.write(f"{name:30s}{found.outcome:9s} {what} {found.note[:300]}\n")
            except CannotBe as error:
                sheet.miss(name, str(error))
                continue
        rows.append([name, *tally.row("done", "refused", "failed"), f"{time.perf_counter() - began:.0f}"])
        failures += [f"{name}: {text}" for text in tally.failures]
    heads = ["fault", "times", "done, whole", "refused, nothing lost", "failed", "wall s"]
    sheet.add(Table("Faults of the machine", heads, rows, notes=failures))
    return len(failures)


def stress(sheet: Sheet, chosen: argparse.Namespace) -> int:
    """A row for each stress, a column for each verb."""
    from torture_pool import Worker
    from torture_stress import MANY, MANY_VERBS, STRESSES, VERBS

    rows, failures, refusals = [], [], []
    with Worker("torture_stress", 0) as worker:
        for name in STRESSES if chosen.quick else (*STRESSES, MANY):
            row: list[str] = [name]
            for verb in VERBS:
                if name == MANY and verb not in MANY_VERBS:
                    row.append("-")
                    continue
                if name == MANY:
                    worker.stop()
                found = worker.ask({"verb": verb, "stress": name}, LONGEST_STRESS)
                row.append(found.note if found.outcome in ("done", "repaired") else found.outcome)
                failures += [f"failed: {verb}, {name}: {found.note}"] if found.outcome == "failed" else []
                refusals += [f"{verb}, {name}: {found.note}"] if found.outcome == "refused" else []
                if chosen.verbose:
                    sys.stderr.write(f"{name:20s}{verb:12s}{found.outcome:9s}{found.seconds:7.1f} {found.note[:300]}\n")
            rows.append(row)
    sheet.add(Table("Numbers under stress", ["stress", *VERBS], rows, notes=[*failures, *refusals]))
    return len(failures)


def main() -> int:
    """Run the sections; 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(SECTIONS), help="sections, comma between")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--random", type=int, default=RANDOM)
    parser.add_argument("--reader", help="of the section `readers`: these alone")
    parser.add_argument("--verb", help="of the section `verbs`: these alone")
    parser.add_argument("--fault", help="of the section `faults`: those with this word")
    parser.add_argument("--verbose", action="store_true", help="each case, on standard error")
    add_options(parser)
    chosen = parser.parse_args()
    sheet = Sheet.of(chosen)
    run = {"readers": readers, "verbs": verbs, "faults": faults, "stress": stress}
    failed = sum(run[name](sheet, chosen) for name in chosen.only.split(","))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
