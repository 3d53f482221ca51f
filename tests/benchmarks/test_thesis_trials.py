"""Short runs of the trials behind the thesis's rows on local optima, the order of the joints and the learning rate."""

import pytest

pytest.importorskip("torch")
from benchmarks.studies import joint_order, learning_rate, local_optima


def rows(capsys):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in capsys.readouterr().out.splitlines()[2:]]


def test_local_optima(capsys):
    assert local_optima.main(["--postures", "12", "--balls", "6", "--steps", "400"]) == 0
    table = rows(capsys)
    assert len(table) == 4
    for _, _, postures, near, reached, short, held in (row for row in table):
        assert int(near) + int(short) == int(postures)
        assert int(reached) <= int(near)
        assert int(held) <= int(short)
    assert sum(int(row[5]) for row in table) > 0


def test_joint_order(capsys):
    assert joint_order.main(["--moves", "3"]) == 0
    table = rows(capsys)
    assert [row[1] for row in table] == ["3", "3", "3"]
    assert table[0][2] == table[0][3] == table[0][4] == "3"


def test_learning_rate(capsys):
    assert learning_rate.main(["--seeds", "1", "--steps", "8000"]) == 0
    table = rows(capsys)
    assert [row[:2] for row in table] == [["0.00025", "0"], ["6.25e-05", "0"]]
    assert all(0.0 <= float(row[2]) <= 100.0 for row in table)
