"""Journal records in the words of a log."""

from __future__ import annotations

import pytest

from lmctl.report.events import event_of

LOCAL = {"wall": "2026-01-02T03:04:05.678Z", "uid": 1000, "where": ["feeder F1"]}


@pytest.mark.parametrize(("kind", "fields", "words", "deviates"), [
    ("header", {"continues": "run-0001"}, "goes on with the part of run-0001", False),
    ("state", {"from": "held", "to": "purging", "event": "resume"}, "held → purging (resume)",
     False),
    ("act", {"do": "powder off", "failed": "no answer"}, "powder off failed: no answer", True),
    ("override", {"feed_percent": 80, "power_percent": 110, "source": "controller"},
     "feed override 80 %, power override 110 % (controller)", True),
    ("override", {"feed_percent": 80, "power_percent": 100, "source": "operator"},
     "feed override 80 % (operator)", False),
    ("operator", {"act": "hold", "operator": "Ada"}, "operator Ada (user 1000): hold", True),
    ("operator", {"act": "hold", "operator": "", "refused": "held already"},
     "operator (user 1000): hold, refused: held already", False),
    ("alarm", {"what": "the door is open", "hint": "close it"},
     "ALARM: the door is open (feeder F1)", True),
    ("alarm_cleared", {"what": "the door is open", "how": "acknowledged"},
     "alarm over (acknowledged): the door is open", False),
    ("fault", {"what": "the link is lost"}, "FAULT: the link is lost; feeder F1", True),
    ("fault", {"what": "no answer", "follows": "the link is lost"}, "then: no answer; feeder F1",
     False),
    ("height", {"layers": 10, "height_mm": 7.85, "planned_mm": 8.0, "volume_factor": 1.0384,
                "at_limit": False, "source": "entered"},
     "height after layer 10: 7.85 mm of 8 mm planned (entered), powder at 103.8 %", False),
    ("height", {"layers": 10, "height_mm": 7.0, "planned_mm": 8.0, "volume_factor": 1.1,
                "at_limit": True, "source": "earlier run"},
     "height after layer 10: 7 mm of 8 mm planned (earlier run), powder at 110 %, the most there "
     "is", True),
    ("height", {"layers": 10, "height_mm": None, "volume_factor": 1.0, "source": "not measured"},
     "height after layer 10: not measured", False),
    ("hose_response", {"source": "measured", "hopper": "A", "dead_time_s": 3.412,
                       "dead_time_half_s": 0.07, "lag_s": 1.0, "lag_half_s": 0.0912,
                       "revision": "replaces"},
     "hopper A measured by a purge: dead time 3.41 ± 0.07 s, lag 1 ± 0.09 s, powder is led by it "
     "from now on", True),
    ("hose_response", {"source": "not measured", "reason": "catch scale: it is full"},
     "this purge measured no hoses: catch scale: it is full", False),
    ("refill", {"hopper": "A", "material": "316L", "lot": "L7", "mass_g": 500.0,
                "weighed_g": 498.2}, "hopper A refilled: 316L, lot L7, 500 g as stated, "
     "498.2 g by weight", False),
    ("refill", {"hopper": "B", "material": "Cu", "lot": "L8", "mass_g": 2.4000000000000004,
                "weighed_g": None}, "hopper B refilled: Cu, lot L8, 2.4 g as stated", False),
])
def test_a_record_is_said_in_words(kind, fields, words, deviates):
    event = event_of({"seq": 7, "t": 1.5, "kind": kind, "local": LOCAL, **fields})
    assert event.text == words
    assert event.is_deviation is deviates
    assert (event.seq, event.t_s, event.wall) == (7, 1.5, LOCAL["wall"])


@pytest.mark.parametrize("kind", ["samples", "setpoint", "path", "executed", "layer", "seal"])
def test_figures_are_no_events(kind):
    assert event_of({"seq": 1, "t": 0.0, "kind": kind}) is None
