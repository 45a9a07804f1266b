"""A fast slice of benchmarks/chaos: two nodes under faults, hostile requests, and the generators of both."""

import random

import pytest
from std_msgs.msg import Float64

from benchmarks.chaos.fuzz import SERVICES, fault_of, fuzz_readers, made
from benchmarks.chaos.fuzz import fuzz as fuzz_nodes
from benchmarks.chaos.hostile import hostile, numbers_of
from benchmarks.chaos.run import Row, table_of, trial, write_page
from poise_msgs.msg import Assembly, InertialEstimate, Robustness
from poise_msgs.srv import AssessRobustness

pytestmark = pytest.mark.ros


@pytest.mark.usefixtures("graph")  # its environment
@pytest.mark.parametrize("node", ["ft_driver", "inertial_estimator"])
def test_a_node_survives_and_is_right_again(node: str, domain: int) -> None:
    faults = ["bad messages", "wrong parameters", "disk fills"]
    rows = trial(node, faults, domain)
    assert [row.fault for row in rows if row.held] == faults, rows


@pytest.mark.usefixtures("graph")
def test_hostile_requests_are_refused_or_answered_consistently(domain: int) -> None:
    found = fuzz_nodes(60, 0, 1, domain)
    assert not found.faults
    assert sum(found.codes.values()) >= 50
    assert sum(number for name, number in found.codes.items() if not name.endswith("OK")) > 20


def test_readers_refuse_hostile_messages_by_a_code() -> None:
    assert not fuzz_readers(1000, 3)


def test_hostile_messages_fit_their_types_and_are_equal_for_equal_seeds() -> None:
    for kind in (Assembly, InertialEstimate, AssessRobustness.Request):
        one, other = (str([hostile(kind, random.Random(seed)) for seed in range(30)]) for _ in range(2))
        assert one == other
        assert "nan" in one
        assert "inf" in one
    assert numbers_of(Float64(data=2.0)) == {"data": 2.0}
    requests = [made(SERVICES[0], random.Random(seed)) for seed in range(50)]
    assert len({str(request) for request in requests}) > 40


def test_an_answer_that_is_not_consistent_is_a_fault() -> None:
    request = AssessRobustness.Request(deadline=0.5)
    sound = AssessRobustness.Response(robustness=[Robustness(robustness=1.0, lower=0.9, upper=1.1)])
    assert fault_of(request, sound) == ""
    assert fault_of(AssessRobustness.Request(map_tolerance=float("nan")), sound) == "code 0 with NaN in map_tolerance"
    swapped = AssessRobustness.Response(robustness=[Robustness(robustness=1.0, lower=1.2, upper=1.1)])
    assert "bounds" in fault_of(request, swapped)
    assert fault_of(request, AssessRobustness.Response(margin=float("nan"))) == "NaN in margin"


def test_the_page_gets_the_table(tmp_path) -> None:
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- table: python -m benchmarks.chaos --page -->\nold\n<!-- end of the table -->\nb\n")
    rows = [Row("ft_driver", "flood", True, 0.24, ""), Row("ft_driver", "full disk", False, 9.0, "a traceback")]
    write_page(page, rows)
    assert "| `ft_driver` | 0.2 s | **failed**: a traceback |" in page.read_text()
    assert page.read_text().startswith("a\n")
    assert page.read_text().endswith("b\n")
    assert "old" not in page.read_text()
    assert table_of(rows).count("\n") == 2
