"""Text tables as different front ends, programs and countries write them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graindamp.errors import InputError
from graindamp.signals.readers.read import read_records
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec

ROWS = [(0.0, 1.5, 20.0), (0.001, -2.25, 10.0), (0.002, 3.0, -5.5), (0.003, 0.5, -7.0)]


def _write(tmp_path: Path, text: str | bytes, name: str = "run.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def _read(tmp_path: Path, text: str | bytes, **options: object) -> Record:
    (record,) = read_records(_write(tmp_path, text), ChannelsSpec.model_validate(options))
    return record


def _table(delimiter: str = ";", decimal: str = ".", end: str = "\n", tail: str = "") -> str:
    rows = (delimiter.join(f"{value:.4f}" for value in row).replace(".", decimal) for row in ROWS)
    return "".join(row + tail + end for row in rows)


def _check(record: Record) -> None:
    """The rows above, with velocity in mm/s."""
    assert record.force.tolist() == [1.5, -2.25, 3.0, 0.5]
    assert record.motion == pytest.approx([0.02, 0.01, -0.0055, -0.007])
    assert record.motion_kind == "velocity"
    assert record.sampling_rate == record.motion_rate == pytest.approx(1000.0)


@pytest.mark.parametrize(
    "text",
    [
        "Time;Force;Velocity\ns;N;mm/s\n" + _table(),
        "Time [s];Force [N];Velocity [mm/s]\n" + _table(decimal=","),
        "Time (s),Force (N),Velocity (mm/s)\n" + _table(","),
        "Time / s\tForce / N\tVelocity / mm/s\r\n" + _table("\t", ",", "\r\n"),
        "Time [s]\tForce [N]\tVelocity [mm/s]\r" + _table("\t", end="\r"),
        "Time [s]  Force [N]  Velocity [mm/s]\n" + _table("  "),
        "t F v\ns N mm/s\n" + _table(" ", ","),
        "# time_s force_n velocity_mm_s\n" + _table(" "),
        "% Zeit;Kraft;Geschwindigkeit\n% [s];[N];[mm/s]\n" + _table(),
        "\ufeffTime;Force;Velocity\n\n[s];[N];[mm/s]\n\n" + _table(),
        '"Time";"Force";"Velocity"\n"s";"N";"mm/s"\n' + _table(),
        "Time [s];Force [N];Velocity [mm/s];\n" + _table(tail=";"),
        "Time [ms];Force [mN];Velocity [m/s]\n"
        + "".join(f"{1e3 * t:.1f};{1e3 * f};{1e-3 * v:.5f}\n" for t, f, v in ROWS),
        "Sampling rate [Hz];1000\nForce [N];Velocity [mm/s]\n" + "".join(f"{f};{v}\n" for _, f, v in ROWS),
        "# fs = 1 kHz\n# comment\nForce,v [mm/s]\n" + "".join(f"{f},{v}\n" for _, f, v in ROWS) + "# end\n",
        "dt;1;ms\nForce;v [mm/s]\n" + "".join(f"{f};{v}\n" for _, f, v in ROWS),
        "Scan rate: 1000 Hz\nN;mm/s\n" + "".join(f"{f};{v}\n" for _, f, v in ROWS),
        "time force velocity_mm_s note\n" + "".join(f"{t} {f} {v} 7\n" for t, f, v in ROWS),
    ],
)
def test_tables_of_all_kinds(tmp_path: Path, text: str) -> None:
    _check(_read(tmp_path, text))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    text = "Zeit [s];Kraft [N];Behälterweg [µm]\n" + _table(decimal=",", end="\r\n")
    record = _read(tmp_path, text.encode(encoding))
    assert record.motion_kind == "displacement"
    assert record.motion == pytest.approx([2e-5, 1e-5, -5.5e-6, -7e-6])


def test_quoted_cells_with_decimal_commas(tmp_path: Path) -> None:
    rows = "".join(",".join(f'"{value:.4f}"'.replace(".", ",") for value in row) + "\n" for row in ROWS)
    _check(_read(tmp_path, '"Time [s]","Force [N]","Velocity [mm/s]"\n' + rows))


def test_header_block(tmp_path: Path) -> None:
    header = (
        "Title;Shaker run 17\nSampling rate [Hz];1000,0\nDrive frequency [Hz];100\nContainer mass [g];85\n"
        "Bed mass;0,1324;kg\nNominal intensity;2,5\nOperator;Force Miller\n\nTime;Force;Velocity\ns;N;mm/s\n"
    )
    record = _read(tmp_path, header + _table(decimal=","))
    _check(record)
    assert (record.sampling_rate, record.frequency, record.nominal_intensity) == (1000.0, 100.0, 2.5)
    assert (record.container_mass, record.bed_mass) == (pytest.approx(0.085), pytest.approx(0.1324))
    assert (record.label, record.source, record.is_empty) == ("run", "run.csv", False)


def test_a_column_of_seconds_is_no_time_where_the_rate_is_told(tmp_path: Path) -> None:
    text = "Sampling rate;1000\nDelay;Force;Velocity\ns;-;mm/s\n" + "".join(f"0.5;{f};{v}\n" for _, f, v in ROWS)
    _check(_read(tmp_path, text))


def test_columns_without_names_are_called_by_number(tmp_path: Path) -> None:
    _check(_read(tmp_path, _table(), force="column 2", motion="column 3", motion_unit="mm/s", sampling_rate=1000))
    with pytest.raises(InputError, match="Channels found: 'column 1', 'column 2', 'column 3'"):
        _read(tmp_path, _table())


def test_cells_without_a_number_stay_as_nan(tmp_path: Path) -> None:
    text = (
        "Time [s];Force [N];Velocity [mm/s]\n0.000;overflow;1\n0.001;;2\n0.002;3;NaN\n0.003;4;\n0.004;5;6\n0.005;5;6\n"
    )
    record = _read(tmp_path, text)
    np.testing.assert_array_equal(record.force, [np.nan, np.nan, 3, 4, 5, 5])
    np.testing.assert_array_equal(record.motion, np.array([1, 2, np.nan, np.nan, 6, 6]) * 1e-3)
    assert record.sampling_rate == pytest.approx(1000)


CELLS = st.floats(-1e4, 1e4, allow_nan=False).map(lambda value: round(value, 5))


@settings(max_examples=60, deadline=None)
@given(
    signals=st.lists(st.tuples(CELLS, CELLS), min_size=3, max_size=30),
    style=st.sampled_from([(";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (" ", "."), ("  ", ",")]),
    end=st.sampled_from(["\n", "\r\n"]),
    rate=st.sampled_from([1000.0, 39215.686, 51200.0]),
    has_time=st.booleans(),
)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory,
    signals: list[tuple[float, float]],
    style: tuple[str, str],
    end: str,
    rate: float,
    has_time: bool,
) -> None:
    delimiter, decimal = style
    key = ":" if delimiter.isspace() else delimiter
    lines = [f"Sampling rate [Hz]{key}{rate}".replace(".", decimal)]
    lines.append(delimiter.join((["Time_s"] if has_time else []) + ["Force_N", "v_m_s"]))
    for i, (force, velocity) in enumerate(signals):
        cells = ([f"{i / rate:.9f}"] if has_time else []) + [f"{force:.5f}", f"{velocity:.5f}"]
        lines.append(delimiter.join(cells).replace(".", decimal))
    record = _read(tmp_path_factory.mktemp("csv"), end.join(lines))
    assert record.force.tolist() == [force for force, _ in signals]  # five decimals are read back exactly
    assert record.motion.tolist() == [velocity for _, velocity in signals]
    assert record.sampling_rate == rate


@pytest.mark.parametrize("form", ["{:.7f}", "{:.6e}", "{:.7g}", "{:.5f}"])
def test_rate_of_a_printed_time_column(tmp_path: Path, form: str) -> None:
    rate = 39215.686
    rows = "".join(f"{form.format(i / rate)};{i % 7};{i % 5}\n" for i in range(3000))
    record = _read(tmp_path, "Time [s];Force;Velocity\n" + rows)
    assert record.sampling_rate == pytest.approx(rate, rel=1e-5 / 0.0765)  # rounding of the coarsest last digit


@pytest.mark.parametrize("form", ["{:.7f}", "{:.6e}", "{:.7g}", "{:.5f}"])
def test_a_missing_sample_is_named(tmp_path: Path, form: str) -> None:
    rows = "".join(f"{form.format(i / 39215.686)};{i % 7};{i % 5}\n" for i in range(1000) if i != 500)
    with pytest.raises(InputError, match=r"channel 'Time \[s\]': time steps are not uniform.*before line 502"):
        _read(tmp_path, "Time [s];Force;Velocity\n" + rows)


HEAD = "Time [s];Force [N];Velocity [mm/s]\n"


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (HEAD + "0;1;2\n0.1;1\n0.2;1;2\n0.3;1;2\n", ["run.csv, line 3", "2 columns, the table has 3", "'0.1;1'"]),
        (HEAD + "0;1;2\n0.1;1;2\n" + HEAD + "0;1;2\n", ["line 4", "text in the middle of the table", "'Time [s];"]),
        (
            "Force [N];Velocity [m/s]\n1;2\n1;2\n",
            ["sampling rate is not told", "Sampling rate [Hz];", "sampling_rate ="],
        ),
        ("Sampling rate;500\n" + HEAD + _table(), ["states a sampling rate of 500 Hz", "1000 Hz", "unit of time"]),
        ("Sampling rate;51,200\n" + HEAD + _table(), ["line 1", "51200 or 51.200"]),
        ("Bed mass;a lot\n" + HEAD + _table(), ["line 1", "'Bed mass' is 'a lot'", "[kg]"]),
        (HEAD + "0;1;2\n0.1;1;2\n;1;2\n0.3;1;2\n", ["no time at line 4", "sampling_rate"]),
        (HEAD + "0.2;1;2\n0.1;1;2\n0.0;1;2\n", ["time does not increase"]),
        ("Time [N];Force;v\n" + _table(), ["'Time [N]' is in 'N'", "no unit of time"]),
        ("Time [s];Force [V];v\n" + _table(), ["'Force [V]' is in 'V'", "force_unit"]),
        (HEAD + "0.00;1;2\n0.00;1;2\n0.01;1;2\n0.01;1;2\n", ["too coarse", "more digits"]),
        ("Force\n1\n2\n", ["no table of numbers with two or more columns"]),
        ("hello\n", ["no table of numbers", "'0.0001;0.0550;249.1'"]),
        (" \n\n", ["no table of numbers"]),
        (b"\x00\x01" * 20, ["binary data, not text"]),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str | bytes, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        _read(tmp_path, text)
    assert all(part in str(caught.value) for part in ["run.csv", *parts])


def test_a_given_rate_makes_the_time_column_irrelevant(tmp_path: Path) -> None:
    text = HEAD + "0;1;2\n0.1;1;2\n0.9;1;2\nlate;1;2\n0.3;1;2\n"
    assert _read(tmp_path, text, sampling_rate="2 kHz").sampling_rate == 2000.0
