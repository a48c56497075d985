"""`cnnum stability` prints records with the fixed names, and exits with 1 if a case fails."""

FIELDS = {"case", "engine", "precision", "outcome", "error", "tolerance", "seconds", "passed"}


def test_records_have_the_fixed_fields(call, records):
    done = call("stability", "form-axis", "--engine", "numba", "--precision", "float64", "--json")
    rows = records(done.stdout)
    assert len(rows) == 4
    assert all(set(row) >= FIELDS and row["passed"] for row in rows)


def test_an_unknown_case_is_refused(call):
    done = call("stability", "nothing")
    assert done.exit_code == 2
    assert "Unknown case 'nothing'" in done.stderr
    assert "Traceback" not in done.stderr
