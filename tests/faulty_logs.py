"""Mutations of good logs: what recorders, spreadsheets, cables and people do to them, by class."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from faulty import COLUMNS, RATE, Fault, csv, good, parquet

Change = Callable[[pd.DataFrame], pd.DataFrame | None]
UR = {"t": "timestamp"} | {
    f"{word}{k}": f"actual_{name}_{k - 1}" for word, name in (("q", "q"), ("i", "current")) for k in (1, 2)
}
JOINTS = ("q1", "q2", "qd1", "qd2", "i1", "i2")


def tables(change: Change, *, only_first: bool = False) -> Callable[[Path], None]:
    """Both logs (or the first) with their tables changed, as CSV."""

    def apply(folder: Path) -> None:
        for number, table in enumerate(good()[: 1 if only_first else None], start=1):
            copy = table.copy()
            changed = change(copy)
            path = folder / "logs" / f"log_{number}.csv"
            path.write_text(csv(copy if changed is None else changed), encoding="utf-8")

    return apply


def raw(change: Callable[[bytes], bytes], *, only_first: bool = False) -> Callable[[Path], None]:
    """Both logs (or the first) with their bytes changed."""

    def apply(folder: Path) -> None:
        for path in sorted((folder / "logs").iterdir())[: 1 if only_first else None]:
            path.write_bytes(change(path.read_bytes()))

    return apply


def as_parquet(change: Callable[[bytes], bytes] = bytes, *, columns: Change = lambda table: None) -> Callable:
    """The logs as Parquet, their tables changed before and the bytes of the first afterwards."""

    def apply(folder: Path) -> None:
        for number, table in enumerate(good(), start=1):
            copy = table.copy()
            changed = columns(copy)
            data = parquet(copy if changed is None else changed)
            (folder / "logs" / f"log_{number}.csv").unlink()
            (folder / "logs" / f"log_{number}.parquet").write_bytes(change(data) if number == 1 else data)

    return apply


def only(data: bytes, name: str = "log.csv") -> Callable[[Path], None]:
    """These bytes as the only log."""

    def apply(folder: Path) -> None:
        for path in (folder / "logs").iterdir():
            path.unlink()
        (folder / "logs" / name).write_bytes(data)

    return apply


def cell(column: str, word: str, *, rows: slice = slice(100, 101)) -> Callable[[Path], None]:
    """A word in some cells of the first log."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        table = table.astype({column: object})
        table.loc[table.index[rows], column] = word
        return table

    return tables(change, only_first=True)


def scaled(factor: float, *columns: str) -> Callable[[Path], None]:
    """Columns times a factor, in both logs."""
    return tables(lambda table: table.assign(**{name: table[name] * factor for name in columns}))


def moved(order: dict[str, str]) -> Callable[[Path], None]:
    """Columns under other names, in both logs."""
    return tables(lambda table: table.rename(columns=order))


def times(change: Callable[[np.ndarray], np.ndarray], *, only_first: bool = False) -> Callable[[Path], None]:
    """Times changed in both logs (or the first)."""
    return tables(lambda table: table.assign(t=np.round(change(table.t.to_numpy().copy()), 6)), only_first=only_first)


def rows(change: Callable[[pd.DataFrame], pd.DataFrame], *, only_first: bool = False) -> Callable[[Path], None]:
    """Rows left out, doubled or in another order."""
    return tables(change, only_first=only_first)


def held(column: str, value: float | None = None, *, part: slice = slice(None)) -> Callable[[Path], None]:
    """A column that stands still over a part of both logs."""

    def change(table: pd.DataFrame) -> None:
        index = table.index[part]
        table.loc[index, column] = table[column].iloc[part.start or 0] if value is None else value

    return tables(change)


def neighbours(table: pd.DataFrame) -> pd.DataFrame:
    """Two rows change places."""
    return table.iloc[[*range(200), 201, 200, *range(202, len(table))]]


def mixed_up(table: pd.DataFrame) -> pd.DataFrame:
    """All but the times in a random order."""
    return table.assign(**shuffled(table)[list(JOINTS)].reset_index(drop=True))


def closed_up(table: pd.DataFrame) -> pd.DataFrame:
    """Every fortieth row lost, and the times of the others as if none were."""
    kept = table.drop(table.index[::40])
    return kept.assign(t=table.t[: len(kept)].to_numpy())


def wider(table: pd.DataFrame) -> pd.DataFrame:
    """Two hundred columns more."""
    return pd.concat([table, pd.DataFrame(0, index=table.index, columns=[f"x{k}" for k in range(200)])], axis=1)


def noisy_times(share: float) -> Callable[[np.ndarray], np.ndarray]:
    """Times that jitter by a share of the interval."""
    return lambda t: np.sort(t + share / RATE * np.random.default_rng(0).uniform(-1, 1, len(t)))


def without(*names: str) -> Change:
    """A table without some columns."""
    return lambda table: table.drop(columns=list(names))


def named(order: dict[str, str]) -> Change:
    """A table with other names."""
    return lambda table: table.rename(columns=order)


def times_by(**factors: float) -> Change:
    """A table with columns multiplied."""
    return lambda table: table.assign(**{name: factor * table[name] for name, factor in factors.items()})


def only_moving(table: pd.DataFrame) -> None:
    """The currents of joints that rest are not logged."""
    for joint in (1, 2):
        table.loc[table[f"qd{joint}"].abs() < 0.05, f"i{joint}"] = np.nan


def now_and_then(share: int) -> Change:
    """Each current in one of so many rows only, in another row each."""

    def change(table: pd.DataFrame) -> None:
        for joint in (1, 2):
            table.loc[table.index % share != joint % share, f"i{joint}"] = np.nan

    return change


def plus(**added: Callable[[pd.DataFrame], object]) -> Change:
    """A table with columns made of the others."""
    return lambda table: table.assign(**{name: make(table) for name, make in added.items()})


def cut(share: float) -> Callable[[bytes], bytes]:
    """The first part of some bytes."""
    return lambda data: data[: int(share * len(data))]


def replaced(old: bytes, new: bytes, count: int = -1) -> Callable[[bytes], bytes]:
    """Bytes with something in place of something else."""
    return lambda data: data.replace(old, new, count)


def friction(joint: int, size: float) -> Callable[[pd.DataFrame], object]:
    """A joint's current with more Coulomb friction."""
    return lambda table: table[f"i{joint}"] + size * np.sign(table[f"qd{joint}"]) * (table[f"qd{joint}"].abs() > 0.05)


def shuffled(table: pd.DataFrame) -> pd.DataFrame:
    """Rows in a random order."""
    return table.sample(frac=1.0, random_state=1)


#: As instruments write them above the columns.


def empty_files() -> Iterator[Fault]:
    """Files without content."""
    for name, data in {
        "no byte": b"", "a line feed": b"\n", "blanks": b"  \n \n", "a byte order mark alone": b"\xef\xbb\xbf",
        "a comment": b"# nothing\n", "one null byte": b"\0",
    }.items():  # fmt: skip
        yield Fault("empty file", name, only(data))
    yield Fault("empty file", "beside a good one", raw(lambda data: b"", only_first=True))
    yield Fault("empty file", "gzip of nothing", only(gzip.compress(b""), "log.csv.gz"))
    yield Fault("empty file", "no log in the folder", only(b"x", "notes.txt"))
    header = ",".join(COLUMNS).encode()
    for name, data in {
        "with line end": header + b"\n", "without line end": header, "with CRLF": header + b"\r\n",
        "and a blank line": header + b"\n\n", "and a cut row": header + b"\n0.1,0.2",
        "and one row": header + b"\n0,0,0,0,0,0,0\n",
    }.items():  # fmt: skip
        yield Fault("header only", name, only(data))
    yield Fault("header only", "Parquet without rows", only(parquet(good()[0].head(0)), "log.parquet"))
    yield Fault("header only", "beside a good one", raw(lambda data: header + b"\n", only_first=True))


def cut_files() -> Iterator[Fault]:
    """Files that end too early, or are none."""
    for share in (0.01, 0.7):
        yield Fault("cut Parquet", f"at {share:.0%}", as_parquet(cut(share)))
    for count in (1, 100):
        yield Fault("cut Parquet", f"last {count} bytes", as_parquet(lambda data, count=count: data[:-count]))
    yield Fault(
        "cut Parquet", "its index flipped", as_parquet(lambda data: data[:-200] + data[-200:-8][::-1] + data[-8:])
    )
    yield Fault("cut Parquet", "index length huge", as_parquet(lambda data: data[:-8] + b"\xff\xff\xff\x7fPAR1"))
    yield Fault("cut Parquet", "a page zeroed", as_parquet(lambda data: data[:3000] + bytes(500) + data[3500:]))
    for share in (0.55,):
        yield Fault("cut CSV", f"at {share:.0%}", raw(cut(share), only_first=True))
    for name, change in {
        "its start is missing": raw(lambda data: data[5000:], only_first=True),
        "gzip cut": only(gzip.compress(csv(good()[0]).encode())[:-500], "log.csv.gz"),
        "a hole of zero bytes": raw(lambda data: data[:90_000] + bytes(4096) + data[94_096:], only_first=True),
        "a block twice": raw(lambda data: data[:80_000] + data[40_000:], only_first=True),
    }.items():
        yield Fault("cut CSV", name, change)
    for name, magic in {
        "zip": b"PK\x03\x04",
        "JSON": b'{"t": [0, 1]}',
        "an image": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        "PDF": b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n1 0 obj\n",
        "random": np.random.default_rng(0).bytes(4000),
    }.items():
        yield Fault("wrong magic", name, only(magic + b"\0\1\2\3" * 20))
    yield Fault("wrong magic", "Parquet's alone", only(b"PAR1", "log.parquet"))
    yield Fault("wrong magic", "Parquet's around nothing", only(b"PAR1" + bytes(20) + b"PAR1", "log.parquet"))
    yield Fault("wrong magic", "gzip's alone", only(b"\x1f\x8b"))
    yield Fault("wrong magic", "CSV named .parquet", only(csv(good()[0]).encode(), "log.parquet"))
    yield Fault("wrong magic", "Parquet named .csv", only(parquet(good()[0]), "log.csv"))


def bad_numbers() -> Iterator[Fault]:
    """What is no number, or none that an arm has."""
    for column, words in {
        "t": ("nan", "1e300", "abc"),
        "q1": ("nan", "", "inf", "1e300", "abc"),
        "qd2": ("nan", "abc"),
        "i1": ("nan", "", "-inf", "1e300", "abc"),
    }.items():
        for word in words:
            yield Fault("NaN, inf, text", f"{word or 'nothing'} in one cell of {column}", cell(column, word))
    for word in ("1,5", "12:30:01", "2024-01-01", "=A1", "0x1F", "1_000", "--1", "1e", "\u0661", "true"):
        yield Fault("NaN, inf, text", f"{word} in one cell of i2", cell("i2", word))
    for column in ("q2", "i2"):
        for share, part in (("3 %", slice(500, 610)), ("half", slice(0, 1800)), ("all", slice(None))):
            yield Fault("NaN, inf, text", f"nan in {share} of {column}", cell(column, "nan", rows=part))
    yield Fault("NaN, inf, text", "nan in the currents of joints that rest", tables(only_moving))
    yield Fault("NaN, inf, text", "nan in four of five currents", tables(now_and_then(5)))
    yield Fault("NaN, inf, text", "nan in nine of ten currents", tables(now_and_then(10)))
    yield Fault("NaN, inf, text", "nan in half of qd1", cell("qd1", "nan", rows=slice(0, 1800)))
    yield Fault("NaN, inf, text", "nan in every third row of qd2", cell("qd2", "nan", rows=slice(0, None, 3)))
    for column in ("t", "q1", "q2", "i1", "i2", "qd1"):
        yield Fault("huge numbers", f"1e5 in one cell of {column}", cell(column, "100000"))
    for column in ("q1", "i1", "i2"):
        yield Fault("huge numbers", f"1e308 in a tenth of {column}", cell(column, "1e308", rows=slice(300, 670)))
        yield Fault("huge numbers", f"{column} times 1e9", scaled(1e9, column))
    yield Fault("huge numbers", "denormals in i1", cell("i1", "1e-320", rows=slice(300, 310)))
    yield Fault("huge numbers", "400 digits in a cell", cell("i1", "0." + "1" * 400))
    yield Fault("huge numbers", "time from 1e15", times(lambda t: t + 1e15))
    yield Fault("huge numbers", "time since 1970", times(lambda t: t + 1.7e9))


def columns() -> Iterator[Fault]:
    """Columns missing, doubled, renamed, swapped."""
    for column in COLUMNS:
        yield Fault("missing columns", column, tables(without(column)))
        yield Fault("renamed columns", f"{column} in capitals with a blank", moved({column: f" {column.upper()}"}))
        yield Fault(
            "doubled columns", column, raw(replaced(b"t,q1", b"t,t" if column == "t" else f"{column},q1".encode(), 1))
        )
    yield Fault("missing columns", "all currents", tables(without("i1", "i2")))
    yield Fault("missing columns", "i2 in one of two logs", tables(without("i2"), only_first=True))
    yield Fault("missing columns", "the header's last name", raw(replaced(b",i2\n", b"\n", 1)))
    yield Fault("missing columns", "the header", raw(lambda data: data.split(b"\n", 1)[1]))
    for name, change in {
        "as another maker's": moved(UR),
        "counted from 0": moved({f"{word}{k}": f"{word}{k - 1}" for word in ("q", "qd", "i") for k in (1, 2)}),
        "quoted": raw(replaced(b"t,q1,q2", b'"t","q1","q2"', 1)),
        "with units": moved({name: f"{name} [A]" for name in ("i1", "i2")}),
        "columns in another order, names with them": tables(lambda table: table[list(COLUMNS[::-1])]),
    }.items():
        yield Fault("renamed columns", name, change)
    for pair in ("q1 q2", "i1 i2", "qd1 qd2", "q1 qd1", "q1 i1", "t q1", "qd1 i1"):
        one, other = pair.split()
        yield Fault("swapped columns", f"{one} and {other}", moved({one: other, other: one}))
        yield Fault(
            "swapped columns",
            f"{one} and {other} in one of two logs",
            tables(named({one: other, other: one}), only_first=True),
        )
    yield Fault(
        "swapped columns",
        "position of both without velocity",
        tables(lambda table: named({"q1": "q2", "q2": "q1"})(without("qd1", "qd2")(table))),
    )


def time_faults() -> Iterator[Fault]:
    """Clocks and the order of rows."""
    yield Fault("shuffled rows", "all", rows(shuffled))
    yield Fault("shuffled rows", "two neighbours", rows(neighbours, only_first=True))
    yield Fault("shuffled rows", "blocks", rows(lambda table: pd.concat([table[2000:], table[:2000]]), only_first=True))
    yield Fault("shuffled rows", "from the end", rows(lambda table: table[::-1]))
    yield Fault("shuffled rows", "values against times", rows(mixed_up))
    yield Fault(
        "repeated time", "one row twice", rows(lambda table: pd.concat([table[:300], table[299:]]), only_first=True)
    )
    yield Fault("repeated time", "every row twice", rows(lambda table: table.iloc[np.repeat(np.arange(len(table)), 2)]))
    yield Fault("repeated time", "all the same", times(lambda t: 0 * t))
    yield Fault("repeated time", "rounded to 0.1 s", times(lambda t: np.floor(10 * t) / 10))
    yield Fault("repeated time", "whole seconds", times(np.floor))
    for name, change in {
        "one stamp": times(lambda t: t - 1.0 * (np.arange(len(t)) == 700), only_first=True),
        "starts anew in the middle": times(lambda t: t - t[1800] * (np.arange(len(t)) >= 1800), only_first=True),
        "a second back in the middle": times(lambda t: t - 1.0 * (np.arange(len(t)) >= 1800), only_first=True),
        "falling": times(lambda t: -t),
        "both logs from 0": times(lambda t: t - t[0]),
    }.items():
        yield Fault("backward time", name, change)
    for name, part in (("one sample", 1), ("0.2 s", 8), ("2 s", 80), ("20 s", 800)):
        yield Fault(
            "gaps",
            f"{name} lost",
            rows(lambda table, part=part: table.drop(table.index[1500 : 1500 + part]), only_first=True),
        )
    yield Fault("gaps", "one row in fifty lost", rows(lambda table: table.drop(table.index[::50])))
    yield Fault("gaps", "one row in three lost", rows(lambda table: table.drop(table.index[::3])))
    yield Fault("gaps", "a day between the halves", times(lambda t: t + 86400.0 * (np.arange(len(t)) > 1800)))
    yield Fault("gaps", "rows lost, times closed up", rows(closed_up))
    for share in (0.1, 0.4, 0.9):
        yield Fault("jitter", f"of {share:.0%} of the interval", times(noisy_times(share)))
    yield Fault(
        "jitter",
        "stamps of packets of five",
        times(lambda t: t[np.arange(len(t)) // 5 * 5] + 1e-4 * (np.arange(len(t)) % 5)),
    )
    yield Fault("jitter", "clock 1 % fast", times(lambda t: 1.01 * t))
    for name, change in {
        "second log at half the rate": rows(lambda table: table[::2], only_first=True),
        "slower from the middle": rows(lambda table: pd.concat([table[:1800], table[1800::2]]), only_first=True),
        "one sample a second": rows(lambda table: table[::40]),
        "ten samples a second": rows(lambda table: table[::4]),
    }.items():
        yield Fault("mixed rates", name, change)
    for name, factor in (("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("min", 1 / 60)):
        yield Fault("mixed rates", f"time in {name}", times(lambda t, factor=factor: factor * t))
    yield Fault("mixed rates", "time in ms in one of two logs", times(lambda t: 1e3 * t, only_first=True))


def lost(column: str, share: float, seed: int) -> Callable[[Path], None]:
    """Some values of a column are 0, as a recorder writes what it has not."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        gone = np.random.default_rng(seed).random(len(table)) < share
        return table.assign(**{column: table[column].where(~gone, 0.0)})

    return tables(change)


def spikes(column: str, size: float, share: float) -> Callable[[Path], None]:
    """Some samples of a column are larger."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        hit = np.random.default_rng(0).random(len(table)) < share
        return table.assign(**{column: table[column] + size * hit})

    return tables(change)


def contact(column: str, size: float, seconds: float) -> Callable[[Path], None]:
    """Something leans on the arm for a while, once."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        moving = np.abs(np.gradient(table[f"q{column[1:]}"], table.t)) > 0.05
        begin = float(table.t[np.flatnonzero(moving)[moving.sum() // 2]])
        touched = (table.t >= begin) & (table.t < begin + seconds)
        return table.assign(**{column: table[column] + size * touched})

    return tables(change, only_first=True)


def repeated(times: int, *names: str) -> Callable[[Path], None]:
    """Columns that are measured only every so many samples."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        first = np.arange(len(table)) // times * times
        return table.assign(**{name: table[name].to_numpy()[first] for name in names})

    return tables(change)


def doubtful_samples() -> Iterator[Fault]:
    """Spikes, contacts, and signals that come over a slower bus."""
    for size in (0.5, 5.0):
        for share in (0.002, 0.05):
            yield Fault("spikes", f"{size:g} A in {100 * share:g} % of i1", spikes("i1", size, share))
    for size in (0.2, 1.0, -1.0):
        for seconds in (0.5, 1.5):
            yield Fault("contacts", f"{size:g} A for {seconds:g} s at joint 1", contact("i1", size, seconds))
            yield Fault("contacts", f"{size:g} A for {seconds:g} s at joint 2", contact("i2", size, seconds))
    for times in (2, 4, 10):
        yield Fault("held signals", f"currents every {times} samples", repeated(times, "i1", "i2"))
        yield Fault("held signals", f"positions every {times} samples", repeated(times, "q1", "q2", "qd1", "qd2"))


def dropouts() -> Iterator[Fault]:
    """Values that were lost and written as 0."""
    for seed, column in enumerate(("i1", "i2", "q1", "q2", "qd1")):
        for share in (0.001, 0.1):
            yield Fault("values lost as 0", f"{100 * share:g} % of {column}", lost(column, share, seed))


def current_faults() -> Iterator[Fault]:
    """Currents that are none."""
    for column in ("i1", "i2"):
        yield Fault("constant current", f"{column} zero", held(column, 0.0))
        yield Fault("constant current", f"{column} at its first value", held(column))
        yield Fault("constant current", f"{column} frozen over a half", held(column, part=slice(1800, None)))
        yield Fault("constant current", f"{column} frozen over 5 s", held(column, part=slice(1800, 2000)))
        yield Fault("constant current", f"{column} zero over 5 s", held(column, 0.0, part=slice(1800, 2000)))
    for name, change in {
        "both zero": tables(lambda table: table.assign(i1=0.0, i2=0.0)),
        "zero in one of two logs": tables(lambda table: table.assign(i1=0.0, i2=0.0), only_first=True),
        "i1 copied to i2": tables(lambda table: table.assign(i2=table.i1)),
        "without sign": tables(lambda table: table.assign(i1=table.i1.abs(), i2=table.i2.abs())),
        "without sign at joint 1": tables(plus(i1=lambda table: table.i1.abs())),
    }.items():
        yield Fault("constant current", name, change)
    for level in (3.9, 3.0, 1.5, 0.3):
        yield Fault(
            "saturated current",
            f"i1 at {level} A",
            tables(plus(i1=lambda table, level=level: table.i1.clip(-level, level))),
        )
    for name, change in {
        "i2 at 1 A": tables(lambda table: table.assign(i2=table.i2.clip(-1.0, 1.0))),
        "i2 at 1 A one way": tables(lambda table: table.assign(i2=table.i2.clip(upper=1.0))),
        "i2 in steps of 0.1 A": tables(lambda table: table.assign(i2=(table.i2 * 10).round() / 10)),
        "i2 in steps of 1 A": tables(lambda table: table.assign(i2=table.i2.round())),
        "q1 stands while the arm moves": held("q1", part=slice(500, 1500)),
    }.items():
        yield Fault("saturated current", name, change)


def dead_bands() -> Iterator[Fault]:
    """Small currents that a drive or a sensor cuts off, or by which it draws all towards zero."""
    for limit in (0.05, 0.3):
        for column in ("i1", "i2"):

            def drawn(table: pd.DataFrame, limit: float = limit, column: str = column) -> pd.Series:
                return np.sign(table[column]) * (table[column].abs() - limit).clip(lower=0.0)

            def cut(table: pd.DataFrame, limit: float = limit, column: str = column) -> pd.Series:
                return table[column].where(table[column].abs() > limit, 0.0)

            yield Fault("dead band", f"{column} drawn to zero by {limit:g} A", tables(plus(**{column: drawn})))
            yield Fault("dead band", f"{column} zero below {limit:g} A", tables(plus(**{column: cut})))


def changes() -> Iterator[Fault]:
    """What is another thing in one log than in the other, by little."""
    kind = "changed between logs"
    for size in (0.02, -0.1):
        for column in ("i1", "i2"):
            name = f"zero of {column} by {size:g} A"
            change = plus(**{column: lambda table, size=size, column=column: table[column] + size})
            yield Fault(kind, name, tables(change, only_first=True))
    for size in (0.02, -0.05, 0.1):
        change = plus(q1=lambda table, size=size: table.q1 + size)
        yield Fault(kind, f"encoder 1 by {size:g} rad", tables(change, only_first=True))
    for size in (0.05, -0.1):
        change = plus(i1=friction(1, size))
        yield Fault(kind, f"friction of joint 1 by {size:g} A", tables(change, only_first=True))
    for share in (1.02, 1.05, 0.9):
        yield Fault(kind, f"gain of joint 1 by {share:g}", tables(times_by(i1=share), only_first=True))


def unit_faults() -> Iterator[Fault]:
    """Degrees for radians and other units."""
    turn = 2 * np.pi
    deg = 360 / turn
    for name, change in {
        "positions": scaled(deg, "q1", "q2"),
        "positions and velocities": scaled(deg, "q1", "q2", "qd1", "qd2"),
        "velocities": scaled(deg, "qd1", "qd2"),
        "positions without velocities": tables(lambda table: times_by(q1=deg, q2=deg)(without("qd1", "qd2")(table))),
        "one joint": scaled(deg, "q2"),
        "one joint without velocities": tables(lambda table: times_by(q2=deg)(without("qd1", "qd2")(table))),
        "one of two logs": tables(times_by(q1=deg, q2=deg, qd1=deg, qd2=deg), only_first=True),
        "turns": scaled(1 / (2 * np.pi), "q1", "q2"),
        "turns with velocities": scaled(1 / (2 * np.pi), "q1", "q2", "qd1", "qd2"),
        "encoder counts": scaled(4096 / (2 * np.pi), "q1", "q2"),
        "a joint backwards, position only": scaled(-1.0, "q1"),
        "a joint backwards with its velocity": scaled(-1.0, "q2", "qd2"),
        "currents in mA": scaled(1e3, "i1", "i2"),
        "currents in mA in one of two logs": tables(times_by(i1=1e3, i2=1e3), only_first=True),
        "encoder zero 90 deg off in one of two logs": tables(
            plus(q2=lambda table: table.q2 + np.pi / 2), only_first=True
        ),
        "positions wrapped": tables(lambda table: table.assign(q1=table.q1 % turn, q2=table.q2 % turn)),
    }.items():
        yield Fault("degrees for radians", name, change)


def other_arms() -> Iterator[Fault]:
    """Logs of another arm, or of a part of it."""
    more = plus(q3=lambda table: table.q1, qd3=lambda table: table.qd1, i3=lambda table: table.i1)
    for name, change in {
        "three joints": tables(more),
        "three joints, Parquet": as_parquet(columns=more),
        "one joint": tables(without("q2", "qd2", "i2")),
        "one joint in one of two logs": tables(without("q2", "qd2", "i2"), only_first=True),
        "lists of numbers in a cell": as_parquet(columns=lambda table: table.assign(q1=[[1.0, 2.0]] * len(table))),
    }.items():
        yield Fault("wrong joint count", name, change)
    for joint in (1, 2):
        yield Fault("one joint missing", f"position of {joint}", tables(without(f"q{joint}", f"qd{joint}")))
        yield Fault("one joint missing", f"all of {joint}", tables(without(f"q{joint}", f"qd{joint}", f"i{joint}")))
        yield Fault("one joint missing", f"current of {joint} empty", held(f"i{joint}", np.nan))
        yield Fault("one joint missing", f"{joint} never moves", held(f"q{joint}", 0.3))
    for name, change in {
        "twice the load in one of two logs": tables(
            plus(i1=lambda table: table.i1 + 3.5 * np.sin(table.q1)), only_first=True
        ),
        "other friction in one of two logs": tables(plus(i2=friction(2, 0.4)), only_first=True),
        "a wall-mounted arm's in one of two logs": tables(
            plus(i1=lambda table: 3.5 * np.cos(table.q1) + table.i2), only_first=True
        ),
        "six joints": tables(
            lambda table: table.assign(**{f"{word}{k}": table[f"{word}1"] for word in ("q", "i") for k in (3, 4, 5, 6)})
        ),
        "a UR's columns": moved({**UR, "qd1": "target_qd_0", "qd2": "target_qd_1"}),
    }.items():
        yield Fault("other robot's log", name, change)


def dialects() -> Iterator[Fault]:
    """How the same numbers are written; what is read as it stands is tested with the reader."""
    for name, change in {
        "two byte order marks": lambda data: b"\xef\xbb\xbf\xef\xbb\xbf" + data,
        "UTF-16 without a mark": lambda data: data.decode().encode("utf-16-le"),
        "some lines end in CRLF": replaced(b"\n", b"\r\n", 500),
        "CR CR LF": replaced(b"\n", b"\r\r\n"),
        "commas for both, not quoted": replaced(b".", b","),
        "a delimiter after the last": replaced(b"\n", b",\n"),
        "thousands separators": lambda data: data.replace(b",", b";").replace(b";2.", b";2,000."),
    }.items():
        yield Fault("dialects", name, raw(change))


def sizes() -> Iterator[Fault]:
    """Headers and lines as of files of gigabytes."""
    header = ",".join(COLUMNS)
    wide = header + "," + ",".join(f"x{k}" for k in range(200_000))
    for name, change in {
        "200 000 columns": only((wide + "\n" + "0," * 200_006 + "0\n").encode()),
        "one name of 40 MB": only(header.encode() + b"," + b"x" * (40 << 20)),
        "a quote that is never closed": raw(replaced(b"\n", b'\n"', 1), only_first=True),
        "gzip that expands to one line of 100 MB": only(gzip.compress(b"t" * (100 << 20), 1), "log.csv.gz"),
        "a row of 2 MB": raw(replaced(b"\n", b"\n" + b"1" * (2 << 20) + b"\n", 1), only_first=True),
        "200 columns besides": tables(wider),
        "a Parquet index that claims 2 GB": as_parquet(lambda data: data[:-8] + b"\xf0\xff\xff\x7fPAR1"),
    }.items():
        yield Fault("headers of gigabytes", name, change)


def all_logs() -> list[Fault]:
    """Every mutation of the logs."""
    makers = (empty_files, cut_files, bad_numbers, columns, time_faults, dropouts, doubtful_samples, current_faults)
    makers += (dead_bands, changes, unit_faults, other_arms, dialects, sizes)
    return [fault for maker in makers for fault in maker()]
