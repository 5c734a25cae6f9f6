import csv
import json

import pytest

from tests.studies.made import measured, study_result, three_cases
from tpdwarp.studies.files import write_csv, write_json
from tpdwarp.studies.result import pareto_front, rows_of
from tpdwarp.studies.table import table_lines


def test_the_front_holds_what_nothing_beats_in_both_time_and_error():
    fast, good, beaten = three_cases().exposures[0].measured
    assert pareto_front([beaten, good, fast]) == (fast, good)


def test_what_is_planned_once_for_an_animation_does_not_count_for_a_frame():
    found = measured("a", 1, 1.5, 2.0)
    found.solution.cpu_seconds["plan"] = 5.0
    assert found.cpu == pytest.approx(2.0)


def test_of_equal_errors_the_fastest_is_on_the_front():
    slow, fast = measured("a", 1, 1.5, 2.0), measured("b", 1, 1.5, 1.0)
    assert pareto_front([slow, fast]) == (fast,)


def test_rows_hold_every_measure(tmp_path):
    rows = rows_of(three_cases())
    assert [row["on_front"] for row in rows] == [True, True, False]
    assert rows[0]["cpu"] == pytest.approx(0.1) and rows[0]["cpu.trace"] == pytest.approx(0.075)
    write_csv(tmp_path / "a.csv", three_cases())
    with open(tmp_path / "a.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    assert [float(line["rmse"]) for line in lines] == [row["rmse"] for row in rows]
    assert {"flip", "bias", "landed", "memory", "cpu.gather"} <= set(lines[0])


def test_json_holds_rows_noise_failures_and_what_was_left(tmp_path):
    result = study_result(measured("tpd", 5, 1.1, 1.0), failed={"x": "broke"}, left=("y",))
    write_json(tmp_path / "a.json", result)
    stored = json.loads((tmp_path / "a.json").read_text())
    assert stored["measured"] == rows_of(result) and stored["truths"] == [{"exposure": 1.0, "relative_noise": 0.01}]
    assert stored["failed"] == {"x": "broke"} and stored["left"] == ["y"]


def test_the_table_lists_the_best_first_and_marks_the_front():
    lines = table_lines(three_cases())
    assert "relative noise 0.01" in lines[0]
    assert [line.split()[0] for line in lines[2:5]] == ["*", "*", "pd"]
    assert "0.0500" in lines[2] and "0.3000" in lines[4]
    assert lines[1].split()[-3:] == ["trace", "gather", "MB"]


def test_the_table_says_what_failed_and_what_was_left():
    text = "\n".join(table_lines(study_result(measured("a", 1, 1.1, 1.0), failed={"b": "broke"}, left=("c", "d"))))
    assert "failed: b: broke" in text and "time was up before 2 more" in text
