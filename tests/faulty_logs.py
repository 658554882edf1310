"""Mutations of good logs: what recorders, spreadsheets, cables and people do to them, by class."""

import gzip
from collections.abc import Callable
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


def times(change: Callable[[np.ndarray], np.ndarray], *, only_first: bool = False) -> Callable[[Path], None]:
    """Times changed in both logs (or the first)."""
    return tables(lambda table: table.assign(t=np.round(change(table.t.to_numpy().copy()), 6)), only_first=only_first)


def held(column: str, value: float | None = None, *, part: slice = slice(None)) -> Callable[[Path], None]:
    """A column that stands still over a part of both logs."""

    def change(table: pd.DataFrame) -> None:
        index = table.index[part]
        table.loc[index, column] = table[column].iloc[part.start or 0] if value is None else value

    return tables(change)


def closed_up(table: pd.DataFrame) -> pd.DataFrame:
    """Every fortieth row lost, and the times of the others as if none were."""
    remaining = table.drop(table.index[::40])
    return remaining.assign(t=table.t[: len(remaining)].to_numpy())


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


def at_random(column: str, share: float, seed: int, change: Callable[[pd.Series], object]) -> Callable[[Path], None]:
    """Another value in a share of the samples of a column."""

    def changed(table: pd.DataFrame) -> pd.DataFrame:
        is_hit = np.random.default_rng(seed).random(len(table)) < share
        return table.assign(**{column: table[column].where(~is_hit, change(table[column]))})

    return tables(changed)


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
    return tables(
        lambda table: table.assign(**{name: table[name][table.index // times * times].values for name in names})
    )


def dead_band(column: str, limit: float, *, is_drawn: bool) -> Callable[[Path], None]:
    """Small currents that a drive or a sensor cuts off, or by which it draws all towards zero."""

    def band(table: pd.DataFrame) -> pd.Series:
        drawn = np.sign(table[column]) * (table[column].abs() - limit).clip(lower=0.0)
        return drawn if is_drawn else table[column].where(table[column].abs() > limit, 0.0)

    return tables(plus(**{column: band}))


HEADER = ",".join(COLUMNS).encode()
TURN = 2 * np.pi
DEG = 360 / TURN


def files() -> dict[str, dict[str, Callable[[Path], None]]]:
    """Files without content, cut, of another kind, in odd dialects, or of lines as in files of gigabytes."""
    text, table = csv(good()[0]).encode(), good()[0]
    return {
        "empty file": {
            "no byte": only(b""),
            "a comment": only(b"# nothing\n"),
            "one null byte": only(b"\0"),
            "a byte order mark alone": only(b"\xef\xbb\xbf"),
            "beside a good one": raw(lambda data: b"", only_first=True),
            "gzip of nothing": only(gzip.compress(b""), "log.csv.gz"),
            "no log in the folder": only(b"x", "notes.txt"),
        },
        "header only": {
            "with CRLF": only(HEADER + b"\r\n"),
            "and a cut row": only(HEADER + b"\n0.1,0.2"),
            "and one row": only(HEADER + b"\n0,0,0,0,0,0,0\n"),
            "Parquet without rows": only(parquet(table.head(0)), "log.parquet"),
            "beside a good one": raw(lambda data: HEADER + b"\n", only_first=True),
        },
        "cut Parquet": {
            "at 70%": as_parquet(cut(0.7)),
            "last byte": as_parquet(lambda data: data[:-1]),
            "its index flipped": as_parquet(lambda data: data[:-200] + data[-200:-8][::-1] + data[-8:]),
            "index length huge": as_parquet(lambda data: data[:-8] + b"\xff\xff\xff\x7fPAR1"),
            "a page zeroed": as_parquet(lambda data: data[:3000] + bytes(500) + data[3500:]),
        },
        "cut CSV": {
            "at 55%": raw(cut(0.55), only_first=True),
            "its start is missing": raw(lambda data: data[5000:], only_first=True),
            "gzip cut": only(gzip.compress(text)[:-500], "log.csv.gz"),
            "a hole of zero bytes": raw(lambda data: data[:90_000] + bytes(4096) + data[94_096:], only_first=True),
            "a block twice": raw(lambda data: data[:80_000] + data[40_000:], only_first=True),
        },
        "wrong magic": {
            "JSON": only(b'{"t": [0, 1]}' + b"\0\1\2\3" * 20),
            "an image": only(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + b"\0\1\2\3" * 20),
            "random": only(np.random.default_rng(0).bytes(4000)),
            "Parquet's alone": only(b"PAR1", "log.parquet"),
            "gzip's alone": only(b"\x1f\x8b"),
            "CSV named .parquet": only(text, "log.parquet"),
            "Parquet named .csv": only(parquet(table)),
        },
        "dialects": {
            "two byte order marks": raw(lambda data: b"\xef\xbb\xbf\xef\xbb\xbf" + data),
            "UTF-16 without a mark": raw(lambda data: data.decode().encode("utf-16-le")),
            "some lines end in CRLF": raw(replaced(b"\n", b"\r\n", 500)),
            "CR CR LF": raw(replaced(b"\n", b"\r\r\n")),
            "commas for both, not quoted": raw(replaced(b".", b",")),
            "a delimiter after the last": raw(replaced(b"\n", b",\n")),
            "thousands separators": raw(lambda data: data.replace(b",", b";").replace(b";2.", b";2,000.")),
        },
        "headers of gigabytes": {
            "one name of 40 MB": only(HEADER + b"," + b"x" * (40 << 20)),
            "a quote that is never closed": raw(replaced(b"\n", b'\n"', 1), only_first=True),
            "gzip that expands to one line of 100 MB": only(gzip.compress(b"t" * (100 << 20), 1), "log.csv.gz"),
            "a row of 2 MB": raw(replaced(b"\n", b"\n" + b"1" * (2 << 20) + b"\n", 1), only_first=True),
        },
    }


def numbers() -> dict[str, dict[str, Callable[[Path], None]]]:
    """What is no number, or none that an arm has."""
    words = {"t": ("nan", "abc"), "q1": ("", "1e300"), "qd2": ("nan", "abc"), "i1": ("-inf", "1e300", "nan")}
    words["i2"] = ("1,5", "12:30:01", "=A1", "0x1F", "1_000", "\u0661", "true")
    single = {
        f"{word or 'nothing'} in one cell of {column}": cell(column, word) for column in words for word in words[column]
    }
    parts = {"3 %": slice(500, 610), "half": slice(0, 1800), "all": slice(None)}
    shares = {
        f"nan in {share} of {column}": cell(column, "nan", rows=part)
        for column in ("q2", "i2")
        for share, part in parts.items()
    }
    return {
        "NaN, inf, text": {
            **single,
            **shares,
            "nan in the currents of joints that rest": tables(only_moving),
            "nan in nine of ten currents": tables(now_and_then(10)),
            "nan in half of qd1": cell("qd1", "nan", rows=slice(0, 1800)),
        },
        "huge numbers": {
            **{f"1e5 in one cell of {column}": cell(column, "100000") for column in ("t", "q1", "i2", "qd1")},
            "1e308 in a tenth of i1": cell("i1", "1e308", rows=slice(300, 670)),
            **{f"{column} times 1e9": scaled(1e9, column) for column in ("q1", "i2")},
            "denormals in i1": cell("i1", "1e-320", rows=slice(300, 310)),
            "400 digits in a cell": cell("i1", "0." + "1" * 400),
            "time from 1e15": times(lambda t: t + 1e15),
            "time since 1970": times(lambda t: t + 1.7e9),
        },
    }


def columns() -> dict[str, dict[str, Callable[[Path], None]]]:
    """Columns missing, doubled, renamed, swapped; logs of another arm, or of a part of it."""
    more = plus(q3=lambda table: table.q1, qd3=lambda table: table.qd1, i3=lambda table: table.i1)
    swaps: dict[str, Callable[[Path], None]] = {}
    for pair in ("q1 q2", "i1 i2", "q1 i1"):
        first, second = pair.split()
        order = {first: second, second: first}
        swaps |= {pair: tables(named(order)), f"{pair} in one of two logs": tables(named(order), only_first=True)}
    return {
        "missing columns": {
            **{column: tables(without(column)) for column in ("t", "q1", "qd2", "i1")},
            "all currents": tables(without("i1", "i2")),
            "i2 in one of two logs": tables(without("i2"), only_first=True),
            "the header's last name": raw(replaced(b",i2\n", b"\n", 1)),
            "the header": raw(lambda data: data.split(b"\n", 1)[1]),
            "position of joint 2": tables(without("q2", "qd2")),
            "all of joint 1": tables(without("q1", "qd1", "i1")),
            "all of joint 2 in one of two logs": tables(without("q2", "qd2", "i2"), only_first=True),
        },
        "doubled columns": {"t": raw(replaced(b"t,q1", b"t,t", 1)), "i1": raw(replaced(b"t,q1", b"i1,q1", 1))},
        "renamed columns": {
            **{
                f"{name} in capitals with a blank": tables(named({name: f" {name.upper()}"}))
                for name in ("t", "q1", "i2")
            },
            "as another maker's": tables(named(UR)),
            "with its velocities": tables(named({**UR, "qd1": "target_qd_0", "qd2": "target_qd_1"})),
            "counted from 0": tables(
                named({f"{word}{k}": f"{word}{k - 1}" for word in ("q", "qd", "i") for k in (1, 2)})
            ),
            "with units": tables(named({name: f"{name} [A]" for name in ("i1", "i2")})),
        },
        "swapped columns": {
            **swaps,
            "position of both without velocity": tables(
                lambda table: named({"q1": "q2", "q2": "q1"})(without("qd1", "qd2")(table))
            ),
        },
        "wrong joint count": {
            "three joints": tables(more),
            "lists of numbers in a cell": as_parquet(columns=lambda table: table.assign(q1=[[1.0, 2.0]] * len(table))),
        },
        "one joint missing": {
            "current empty": held("i2", np.nan),
            **{f"{joint} never moves": held(f"q{joint}", 0.3) for joint in (1, 2)},
        },
    }


def clocks() -> dict[str, dict[str, Callable[[Path], None]]]:
    """Clocks and the order of rows."""
    late = np.arange(len(good()[0])) >= 1800
    return {
        "shuffled rows": {
            "all": tables(shuffled),
            "two neighbours": tables(
                lambda table: table.iloc[[*range(200), 201, 200, *range(202, len(table))]], only_first=True
            ),
            "from the end": tables(lambda table: table[::-1]),
            "values against times": tables(
                lambda table: table.assign(**shuffled(table)[list(JOINTS)].reset_index(drop=True))
            ),
        },
        "repeated time": {
            "one row twice": tables(lambda table: pd.concat([table[:300], table[299:]]), only_first=True),
            "every row twice": tables(lambda table: table.iloc[np.repeat(np.arange(len(table)), 2)]),
            "all the same": times(lambda t: 0 * t),
            "rounded to 0.1 s": times(lambda t: np.floor(10 * t) / 10),
        },
        "backward time": {
            "one stamp": times(lambda t: t - 1.0 * (np.arange(len(t)) == 700), only_first=True),
            "starts anew in the middle": times(lambda t: t - t[1800] * late, only_first=True),
            "a second back in the middle": times(lambda t: t - 1.0 * late, only_first=True),
            "both logs from 0": times(lambda t: t - t[0]),
        },
        "gaps": {
            "2 s lost": tables(lambda table: table.drop(table.index[1500:1580]), only_first=True),
            "one row in three lost": tables(lambda table: table.drop(table.index[::3])),
            "a day between the halves": times(lambda t: t + 86400.0 * late),
            "rows lost, times closed up": tables(closed_up),
        },
        "jitter": {
            **{f"of {share:.0%} of the interval": times(noisy_times(share)) for share in (0.1, 0.9)},
            "stamps of packets of five": times(
                lambda t: t[np.arange(len(t)) // 5 * 5] + 1e-4 * (np.arange(len(t)) % 5)
            ),
            "clock 1 % fast": times(lambda t: 1.01 * t),
        },
        "mixed rates": {
            "second log at half the rate": tables(lambda table: table[::2], only_first=True),
            "slower from the middle": tables(lambda table: pd.concat([table[:1800], table[1800::2]]), only_first=True),
            "one sample a second": tables(lambda table: table[::40]),
            "ten samples a second": tables(lambda table: table[::4]),
            "time in ms": times(lambda t: 1e3 * t),
            "time in minutes": times(lambda t: t / 60),
            "time in ms in one of two logs": times(lambda t: 1e3 * t, only_first=True),
        },
    }


def currents() -> dict[str, dict[str, Callable[[Path], None]]]:
    """Currents that are none, spikes, contacts, and signals that come over a slower bus."""
    return {
        "values lost as 0": {
            f"{100 * share:g} % of {column}": at_random(column, share, seed, lambda values: 0.0 * values)
            for seed, column in enumerate(("i1", "q2", "qd1"))
            for share in (0.001, 0.1)
        },
        "spikes": {
            f"{size:g} A in {share:.1%} of i1": at_random("i1", share, 0, lambda values, size=size: values + size)
            for size, share in ((0.5, 0.002), (5.0, 0.05))
        },
        "contacts": {
            f"{size:g} A for {seconds:g} s at joint {joint}": contact(f"i{joint}", size, seconds)
            for size, seconds, joint in ((0.2, 1.5, 1), (-1.0, 0.5, 2))
        },
        "held signals": {
            f"{names} every {count} samples": repeated(count, *names.split())
            for count in (2, 10)
            for names in ("i1 i2", "q1 q2 qd1 qd2")
        },
        "constant current": {
            "i1 zero": held("i1", 0.0),
            "i2 at its first value": held("i2"),
            "i1 frozen over a half": held("i1", part=slice(1800, None)),
            "i2 frozen over 5 s": held("i2", part=slice(1800, 2000)),
            "zero in one of two logs": tables(lambda table: table.assign(i1=0.0, i2=0.0), only_first=True),
            "i1 copied to i2": tables(lambda table: table.assign(i2=table.i1)),
            "without sign": tables(plus(i1=lambda table: table.i1.abs(), i2=lambda table: table.i2.abs())),
            "without sign at joint 1": tables(plus(i1=lambda table: table.i1.abs())),
        },
        "saturated current": {
            "i1 at 3.9 A": tables(plus(i1=lambda table: table.i1.clip(-3.9, 3.9))),
            "i1 at 1.5 A": tables(plus(i1=lambda table: table.i1.clip(-1.5, 1.5))),
            "i2 at 1 A one way": tables(plus(i2=lambda table: table.i2.clip(upper=1.0))),
            "i2 in steps of 1 A": tables(plus(i2=lambda table: table.i2.round())),
            "q1 stands while the arm moves": held("q1", part=slice(500, 1500)),
        },
        "dead band": {
            f"{column} {limit:g} A{', drawn' * is_drawn}": dead_band(column, limit, is_drawn=is_drawn)
            for column, limit, is_drawn in (("i1", 0.05, True), ("i2", 0.3, False))
        },
    }


def units_and_changes() -> dict[str, dict[str, Callable[[Path], None]]]:
    """Degrees for radians and other units; what is another thing in one log than in the other."""
    no_velocity = without("qd1", "qd2")
    changed = {
        "zero of i1 by 0.02 A": plus(i1=lambda table: table.i1 + 0.02),
        "zero of i2 by -0.1 A": plus(i2=lambda table: table.i2 - 0.1),
        "encoder 1 by 0.1 rad": plus(q1=lambda table: table.q1 + 0.1),
        "encoder 2 by 90 deg": plus(q2=lambda table: table.q2 + np.pi / 2),
        "friction of joint 1 by 0.05 A": plus(i1=friction(1, 0.05)),
        "friction of joint 2 by 0.4 A": plus(i2=friction(2, 0.4)),
        "gain of joint 1 by 0.9": times_by(i1=0.9),
        "twice the load": plus(i1=lambda table: table.i1 + 3.5 * np.sin(table.q1)),
        "a wall-mounted arm's": plus(i1=lambda table: 3.5 * np.cos(table.q1) + table.i2),
        "degrees": times_by(q1=DEG, q2=DEG, qd1=DEG, qd2=DEG),
        "mA": times_by(i1=1e3, i2=1e3),
    }
    return {
        "changed between logs": {name: tables(change, only_first=True) for name, change in changed.items()},
        "degrees for radians": {
            "positions": scaled(DEG, "q1", "q2"),
            "positions and velocities": scaled(DEG, "q1", "q2", "qd1", "qd2"),
            "velocities": scaled(DEG, "qd1", "qd2"),
            "positions without velocities": tables(lambda table: times_by(q1=DEG, q2=DEG)(no_velocity(table))),
            "one joint": scaled(DEG, "q2"),
            "one joint without velocities": tables(lambda table: times_by(q2=DEG)(no_velocity(table))),
        },
        "other units": {
            "turns": scaled(1 / TURN, "q1", "q2"),
            "encoder counts": scaled(4096 / TURN, "q1", "q2"),
            "a joint backwards, position only": scaled(-1.0, "q1"),
            "a joint backwards with its velocity": scaled(-1.0, "q2", "qd2"),
            "positions wrapped": tables(plus(q1=lambda table: table.q1 % TURN, q2=lambda table: table.q2 % TURN)),
        },
    }


def all_logs() -> list[Fault]:
    """Every mutation of the logs."""
    kinds = files() | numbers() | columns() | clocks() | currents() | units_and_changes()
    return [Fault(kind, name, change) for kind, changes in kinds.items() for name, change in changes.items()]
