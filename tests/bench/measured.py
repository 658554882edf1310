"""Measurements as rows of a CSV file in bench/."""

import datetime
import os
import platform
from collections.abc import Iterable
from pathlib import Path

import pandas as pd


def append(path: Path, records: Iterable[dict[str, object]], **about: object) -> None:
    """Append each record as it comes, with the day, the machine and what else is to be said of all; print it, too."""
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    about = {"day": day, "cores": os.cpu_count(), "machine": platform.machine()} | about
    table = pd.read_csv(path, dtype=str) if path.exists() else pd.DataFrame()
    for record in records:
        rounded = {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in record.items()}
        table = pd.concat([table, pd.DataFrame([about | rounded])])
        table.to_csv(path, index=False)
        print(", ".join(f"{name} {value}" for name, value in rounded.items()), flush=True)
