"""Everything the controller says, against what both real firmwares did say."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.messages import (
    AlarmMessage,
    ErrorReply,
    FeedbackMessage,
    OkReply,
    SettingMessage,
    StartupBlockReply,
    StartupBlockSetting,
    StatusMessage,
    UnknownMessage,
    WelcomeBanner,
    parse_message,
)
from firmware_protocol.status import StatusReport, parse_status

KNOWN = {"MPos", "WPos", "WCO", "Bf", "Ln", "F", "FS", "Ov", "Pn", "A"}


def test_every_line_of_both_firmwares_is_known_and_is_written_back_as_it_came(scenarios):
    lines = [line for scenario in scenarios for line in scenario.received if line]
    assert len(lines) > 400
    for line in lines:
        message = parse_message(line)
        assert not isinstance(message, UnknownMessage), line
        assert message.format() == line


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("ok", OkReply()),
        ("error:25", ErrorReply(25)),
        ("ALARM:3", AlarmMessage(3)),
        ("Grbl 1.1h ['$' for help]", WelcomeBanner("Grbl 1.1h ['$' for help]")),
        ("[MSG:]", FeedbackMessage("MSG", "")),
        ("[AUX IO:4,8,0,4]", FeedbackMessage("AUX IO", "4,8,0,4")),
        ("[GC:G0 G54 S0.]", FeedbackMessage("GC", "G0 G54 S0.")),
        ("$110=6000.000", SettingMessage(110, "6000.000")),
        ("$N0=", StartupBlockSetting(0, "")),
        (">G54G20:ok", StartupBlockReply("G54G20", "ok")),
        (">G54:error:7", StartupBlockReply("G54", "error:7")),
        (
            "<Hold:1|MPos:12.280,0.000,-3.500|Bf:99,1023|FS:0,0|A:C>",
            StatusMessage(
                StatusReport(
                    "Hold", 1, machine_mm=(12.28, 0.0, -3.5), planner_blocks_free=99,
                    rx_bytes_free=1023,
                    feed_mm_min=0.0, spindle_speed=0.0, accessories="C",
                )
            ),
        ),
    ],
)
def test_each_kind_of_message(line, expected):
    assert parse_message(line) == expected
    assert expected.format() == line


@pytest.mark.parametrize(
    "line",
    [
        "OK", "ok ", " ok", "okok", "error:", "error:x", "error:1234", "error: Bad number",
        "ALARM:", "[MSG]", "[:x]", "$x=1", "$110", "<>", "<Idle", "Idle>", "<idle>", "<Idle:>",
        "<Idle|>", "<Idle|MPos:1,2>", "<Idle|MPos:1,2,x>", "<Idle|MPos:nan,0,0>",
        "<Idle|MPos:1e3,0,0>", "<Idle|MPos:1.2.3,0,0>", "<Idle|Bf:15>", "<Idle|Bf:-1,128>",
        "<Idle|Ln:>", "<Idle|Ln:1.5>", "<Idle|FS:1>", "<Idle|Ov:100,100>", "<Idle|Pn:X!>",
        "<Idle|MPos:0,0,0|MPos:0,0,0>", "<Idle|F:1|FS:1,0>", "<Runn|MPos:0,0,0>",
        "Grbl", "Grbl 1.1h", "grbl 1.1h ['$' for help]", "\x00", "hello",
    ],
)
def test_damaged_lines_are_unknown(line):
    assert parse_message(line) == UnknownMessage(line)


def test_status_fields_may_stand_in_any_order_and_unknown_ones_are_kept():
    report = parse_status("<Run|X9:a,b|FS:600,50|Ln:7|SD:|Bf:1,2|MPos:1,2,3|WPos:0,1,2>")
    assert report == StatusReport(
        "Run", machine_mm=(1, 2, 3), work_mm=(0, 1, 2), planner_blocks_free=1, rx_bytes_free=2,
        line_number=7,
        feed_mm_min=600, spindle_speed=50, unknown_fields=(("X9", "a,b"), ("SD", "")),
    )
    assert report.format() == (
        "<Run|MPos:1.000,2.000,3.000|WPos:0.000,1.000,2.000|Bf:1,2|Ln:7|FS:600,50|X9:a,b|SD:>"
    )


@given(
    st.sampled_from(["Run", "Idle", "Hold", "Alarm"]), st.lists(st.floats(-1e6, 1e6), min_size=3,
                                                               max_size=4),
    st.lists(st.integers(0, 10**7), min_size=3, max_size=3), st.floats(0, 1e5), st.floats(0, 1e5),
)
def test_the_usual_report_is_written_as_its_fields_are_one_by_one(state, at, counts, feed, spindle):
    blocks, rx, line = counts
    usual = StatusReport(
        state, machine_mm=tuple(at), planner_blocks_free=blocks, rx_bytes_free=rx, line_number=line,
        feed_mm_min=feed, spindle_speed=spindle,
    )
    assert usual._replace(accessories="S").format() == usual.format()[:-1] + "|A:S>"


@pytest.mark.parametrize(
    ("field", "key", "value"),
    [
        ("AR", "AR", None), ("$C:1", "$C", "1"), ("In:", "In", ""), ("Sc:XYZ", "Sc", "XYZ"),
        ("9", "9", None), ("SD:12.5,/a_b.nc", "SD", "12.5,/a_b.nc"),
        ("a-b_c.d:1:2", "a-b_c.d", "1:2"),
    ],
)
def test_an_unknown_field_is_kept_and_never_voids_a_report(field, key, value):
    """Firmware adds fields, with a value or without, under any name."""
    text = f"<Idle|MPos:1.000,2.000,3.000|{field}|FS:0,0|H:1>"
    report = parse_status(text)
    assert report is not None
    assert report.machine_mm == (1.0, 2.0, 3.0)
    assert report.unknown_fields == ((key, value), ("H", "1"))
    assert parse_status(report.format()) == report
    twice = parse_status(f"<Idle|{field}|{field}|MPos:1.000,2.000,3.000>")
    assert twice is not None
    assert twice.unknown_fields == ((key, value), (key, value))


@given(st.lists(st.from_regex(r"[!-;=?-{}~]{1,20}", fullmatch=True), max_size=5))
def test_whatever_is_added_the_known_fields_are_read(fields):
    added = [f for f in fields if f.partition(":")[0] not in KNOWN and not f.startswith(":")]
    report = parse_status("<" + "|".join(["Run", "MPos:1,2,3", *added, "Ln:7"]) + ">")
    assert report is not None
    assert (report.machine_mm, report.line_number, len(report.unknown_fields)) == ((1, 2, 3), 7,
                                                                                   len(added))


@pytest.mark.parametrize("kind", ["NEW_OPT", "$C", "PLUGIN-2", "9", "A very new kind/of message"])
def test_an_unknown_kind_of_message_is_kept(kind):
    assert parse_message(f"[{kind}:a:b]") == FeedbackMessage(kind, "a:b")
    assert FeedbackMessage(kind, "a:b").format() == f"[{kind}:a:b]"


def test_feed_alone_and_a_measured_spindle_speed():
    assert parse_status("<Idle|F:500>").feed_mm_min == 500
    assert parse_status("<Idle|F:500>").format() == "<Idle|F:500>"
    assert parse_status("<Idle|FS:500,10,9>").spindle_speed_measured == 9
    assert parse_status("<Idle|FS:500,10,9>").format() == "<Idle|FS:500,10,9>"


def test_an_empty_accessory_field_is_not_a_missing_one():
    assert parse_status("<Idle|A:>").accessories == ""
    assert parse_status("<Idle>").accessories is None


@given(st.text(max_size=120))
def test_any_text_is_a_message(text):
    assert parse_message(text).format() is not None


@given(st.text(alphabet="<>|:,.-0123456789IdleRunMPosWCOBfLnFSvA", max_size=60))
def test_any_near_report_is_parsed_or_unknown(inner):
    message = parse_message(f"<Run|{inner}>")
    assert isinstance(message, StatusMessage | UnknownMessage)
    # what was believed survives being written and read again
    if isinstance(message, StatusMessage):
        again = parse_message(message.format())
        assert isinstance(again, StatusMessage)


@given(
    st.sampled_from(["Run", "Idle"]), st.lists(st.decimals(-999, 999, places=3), min_size=3,
                                              max_size=3),
    st.integers(0, 999), st.integers(0, 9999), st.none() | st.integers(0, 10**7),
    st.integers(0, 9999), st.integers(0, 1000),
)
def test_the_order_of_the_fields_says_nothing(state, position, blocks, rx, line, feed, speed):
    fields = [f"MPos:{','.join(map(str, position))}", f"Bf:{blocks},{rx}"]
    fields += [] if line is None else [f"Ln:{line}"]
    fields += [f"FS:{feed},{speed}"]
    usual = parse_status(f"<{'|'.join([state, *fields])}>")
    assert usual is not None
    assert usual == parse_status(f"<{'|'.join([state, *reversed(fields)])}>")
    assert usual.line_number == line
