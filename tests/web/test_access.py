"""Tokens, the operator's seat and the rate of requests: who may do what, and how often."""

from __future__ import annotations

import pytest

from lmctl.errors import ConfigError, LmctlError, UsageError
from lmctl.web.access import AccessPolicy, AccessRole, access_policy, read_token
from lmctl.web.operator_seat import IDLE_S, OperatorSeat
from lmctl.web.rate_limit import RateLimit
from tests.web.conftest import OPERATOR, VIEWER


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.mark.parametrize(("authorization", "without_viewer_token", "with_viewer_token"), [
    (None, AccessRole.VIEWER, AccessRole.NONE),
    (f"Bearer {OPERATOR}", AccessRole.OPERATOR, AccessRole.OPERATOR),
    (f"bearer {OPERATOR}", AccessRole.OPERATOR, AccessRole.OPERATOR),
    (f"Bearer {VIEWER}", AccessRole.NONE, AccessRole.VIEWER),
    (f"Bearer {OPERATOR}x", AccessRole.NONE, AccessRole.NONE),
    (f"Bearer {OPERATOR[:-1]}", AccessRole.NONE, AccessRole.NONE),
    ("Bearer ", AccessRole.NONE, AccessRole.NONE),
    ("", AccessRole.NONE, AccessRole.NONE),
    (OPERATOR, AccessRole.NONE, AccessRole.NONE),
    (f"Basic {OPERATOR}", AccessRole.NONE, AccessRole.NONE),
    ("Bearer " + "x" * 100_000, AccessRole.NONE, AccessRole.NONE),
    ("Bearer \udcff", AccessRole.NONE, AccessRole.NONE),
])
def test_a_token_gives_its_role_and_nothing_else(
    authorization, without_viewer_token, with_viewer_token
):
    assert AccessPolicy(OPERATOR).role_of(authorization) is without_viewer_token
    assert AccessPolicy(OPERATOR, VIEWER).role_of(authorization) is with_viewer_token


def token_file(folder, name, text, mode=0o600):
    path = folder / name
    path.write_text(text)
    path.chmod(mode)
    return path


def test_elsewhere_than_on_this_machine_both_tokens_are_needed(tmp_path):
    operator = token_file(tmp_path, "operator", OPERATOR + "\n")
    viewer = token_file(tmp_path, "viewer", VIEWER)
    for files in ((None, None), (operator, None), (None, viewer)):
        with pytest.raises(UsageError, match="others can reach this page"):
            access_policy("0.0.0.0", *files)
    policy = access_policy("0.0.0.0", operator, viewer)
    assert policy.role_of(f"Bearer {OPERATOR}") is AccessRole.OPERATOR
    assert policy.role_of(None) is AccessRole.NONE
    with pytest.raises(ConfigError, match="same token"):
        access_policy("0.0.0.0", operator, operator)


def test_on_this_machine_a_token_is_made_up_that_is_never_the_same(tmp_path):
    first, second = (access_policy("127.0.0.1", None, None) for _ in range(2))
    assert first.operator_token != second.operator_token
    assert len(first.operator_token) >= 32
    assert first.role_of(None) is AccessRole.VIEWER


def test_a_token_that_others_can_read_or_guess_is_refused_with_all_reasons(tmp_path):
    with pytest.raises(LmctlError) as refusal:
        read_token(token_file(tmp_path, "open", "too short", 0o644))
    text = refusal.value.render()
    assert "chmod 600" in text
    assert "9 characters" in text
    assert "without spaces" in text


def test_one_operates_at_a_time_and_another_takes_over_only_on_purpose(clock):
    seat = OperatorSeat(clock)
    ada = seat.take("Ada", "10.0.0.1")
    with pytest.raises(UsageError, match="Ada is the operator already"):
        seat.take("Bob", "10.0.0.2")
    assert seat.holder_of(ada) == "Ada (live page, 10.0.0.1)"
    bob = seat.take("Bob", "10.0.0.2", take_over=True)
    with pytest.raises(UsageError, match="Bob has it"):
        seat.holder_of(ada)
    seat.leave(bob)
    assert seat.operator == ""
    with pytest.raises(UsageError, match="do not have"):
        seat.holder_of(bob)


def test_a_seat_is_free_again_once_its_operator_has_been_silent(clock):
    seat = OperatorSeat(clock)
    key = seat.take("Ada", "10.0.0.1")
    clock.now_s += IDLE_S - 1
    seat.holder_of(key)
    clock.now_s += IDLE_S - 1
    assert seat.operator == "Ada"
    clock.now_s += 2
    assert seat.operator == ""
    with pytest.raises(UsageError):
        seat.holder_of(key)


def test_an_act_that_was_recorded_and_sent_again_is_refused(clock):
    seat = OperatorSeat(clock)
    seat.take("Ada", "10.0.0.1")
    seat.accept_number(5)
    for number in (5, 4, 0, -1, 5.5, "6", None, True, 2**60):
        with pytest.raises(UsageError):
            seat.accept_number(number)
    seat.accept_number(6)


@pytest.mark.parametrize("name", ["", "  ", "a" * 81, "Ada\n", "\x1b[31m", 7, None])
def test_an_operator_has_a_name(clock, name):
    with pytest.raises(UsageError, match="is a name"):
        OperatorSeat(clock).take(name, "10.0.0.1")


def test_each_address_has_requests_of_its_own_that_come_back_with_time(clock):
    rate = RateLimit(2.0, 3.0, clock)
    assert [rate.take("a") for _ in range(5)] == [True, True, True, False, False]
    assert rate.take("b")
    clock.now_s += 1.0
    assert [rate.take("a") for _ in range(3)] == [True, True, False]
    for number in range(5000):
        rate.take(f"c{number}")
    assert len(rate._buckets) <= 1000
