"""`lmctl help`, `lmctl schema`, `lmctl completion`."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from lmctl.reference.key_row import FILE_KINDS


def test_a_key_is_explained(lmctl):
    outcome = lmctl("help", "part.process.layer_height_mm")
    assert outcome.code == 0
    assert outcome.data.splitlines()[0] == "part.process.layer_height_mm"
    for word in ("number", "mm", "0.8", "from 0.005 to 100", "layer_height_mm = "):
        assert word in outcome.data


def test_a_table_lists_its_keys(lmctl):
    outcome = lmctl("help", "machine.hopper")
    for key in ("dead_time_s", "lag_s", "channel"):
        assert f"machine.hopper.{key}" in outcome.data


@pytest.mark.parametrize(
    ("short", "whole"),
    [("process.overlap", "part.process.overlap"), ("hopper.lag_s", "machine.hopper.lag_s"),
     ("box.low_mm", "part.body.box.low_mm")],
)
def test_a_path_may_leave_out_what_is_clear(lmctl, short, whole):
    assert whole in lmctl("help", short).data


def test_a_command_is_explained(lmctl):
    assert "Usage: lmctl plan" in lmctl("help", "plan").data


def test_without_a_word_help_says_what_it_knows(lmctl):
    data = lmctl("help").data
    assert all(f"  {kind} " in data for kind in FILE_KINDS)


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [("part.process.overlapp", "part.process.overlap"), ("machine.hopper.lag", "lag_s"),
     ("map.misssing", "map.missing"), ("quux.quux", "lmctl help")],
)
def test_an_unknown_key_is_answered_by_the_one_meant(refused, wrong, meant):
    told = refused("help", wrong, code=2)
    assert f"there is no key {wrong!r}" in told
    assert meant in told.partition("hint:")[2]


@pytest.mark.parametrize("kind", FILE_KINDS)
def test_a_schema_is_printed(lmctl, kind):
    schema = lmctl("schema", kind).json
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert schema["properties"]


def test_help_loads_no_models():
    program = (
        "import sys; from lmctl.cli.__main__ import main; main(['help', 'part.process.overlap']);"
        "print(sorted(set(sys.modules) & {'pydantic', 'numpy', 'asyncio'}), file=sys.stderr)")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                          check=True)
    assert done.stderr.strip() == "[]"


@pytest.mark.parametrize(
    ("words", "found"),
    [("lmctl che", "check"), ("lmctl help part.process.ove", "part.process.overlap"),
     ("lmctl schema ma", "machine"), ("lmctl completion f", "fish")],
)
def test_a_shell_is_told_what_may_follow(words, found):
    environment = os.environ | {"_LMCTL_COMPLETE": "bash_complete", "COMP_WORDS": words,
                                "COMP_CWORD": str(len(words.split()) - 1)}
    done = subprocess.run([sys.executable, "-m", "lmctl.cli"], env=environment, text=True,
                          capture_output=True, check=False)
    assert f"plain,{found}" in done.stdout.splitlines(), done.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_prints_a_script(lmctl, shell):
    script = lmctl("completion", shell).data
    assert f"_LMCTL_COMPLETE={shell}_complete" in script
    if shell == "bash":
        assert subprocess.run(["bash", "-n"], input=script, text=True, check=False).returncode == 0


def test_what_is_printed_as_a_schema_is_json_for_any_reader(lmctl):
    assert json.loads(lmctl("schema", "part").data)["title"] == "the part file"
