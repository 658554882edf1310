"""Make every number of docs/real_data.md again: ``python tools/real_data.py [-o FILE]``.

The recordings are looked for where ``PUMAID_REAL_DATA`` points, else in ``shared/data`` beside the checkout.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import real_data_diagnosis
import real_data_gen3
import real_data_others
import real_data_ur3e
from recordings import folder


def main() -> None:
    """Print the report, or write it to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", type=Path, metavar="FILE", help="write the report there instead of printing it")
    chosen = parser.parse_args()
    if not folder().is_dir():
        raise SystemExit("the recordings are not there: set PUMAID_REAL_DATA to their folder")
    told: list[str] = []
    with TemporaryDirectory() as scratch:
        for section in (real_data_ur3e, real_data_gen3, real_data_others, real_data_diagnosis):
            told += [*section.lines(Path(scratch)), ""]
    text = "\n".join(told)
    if chosen.o is None:
        print(text)
    else:
        chosen.o.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
