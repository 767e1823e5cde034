"""`lmctl check` of a register map, and runs with one."""

from importlib.resources import files

EXAMPLES = files("lmctl.examples")


def test_a_map_is_checked_and_what_it_lacks_is_said(lmctl, tmp_path):
    (tmp_path / "map.toml").write_text((EXAMPLES / "feeder-tcp.toml").read_text())
    outcome = lmctl("check", "map.toml")
    assert outcome.code == 0
    assert "a register map of Meridian dosing rack, 11 registers, 2 hoppers" in outcome.data
    assert "without watchdog: powder goes on when the host stops" in outcome.talk


def test_all_mistakes_of_a_map_are_told_at_once(refused, tmp_path):
    text = (EXAMPLES / "feeder-tcp.toml").read_text()
    text = text.replace("address = 24", "address = 23").replace('watchdog = "interlock"\n', "")
    (tmp_path / "map.toml").write_text(text.replace("maximum = 6,", "maximum = -1,"))
    told = refused("check", "map.toml", code=3)
    for part in ("4 mistakes", "overlaps 'H1.STOCK'", "overlaps 'H2.STOCK'",
                 "minimum 0 is above maximum -1", "watchdog.heartbeat: is missing"):
        assert part in told


def test_a_map_given_as_a_profile_is_recognised(refused, tmp_path):
    (tmp_path / "map.toml").write_text((EXAMPLES / "feeder-rtu.toml").read_text())
    told = refused("check", "box.stl", "--machine", "map.toml", code=2)
    assert "there is no file" in told
    (tmp_path / "job.lmj").write_bytes(b"")
    told = refused("check", "job.lmj", "--machine", "map.toml", code=3)
    assert "map.toml is a register map" in told


def test_a_simulated_run_uses_the_maps_of_the_profile(lmctl, box, tmp_path):
    cell = (tmp_path / "cell.toml").read_text()
    (tmp_path / "feeder.toml").write_text((EXAMPLES / "feeder-rtu.toml").read_text())
    (tmp_path / "mapped.toml").write_text(
        cell.replace('name = "F1"\n', 'name = "F1"\nmap = "feeder.toml"\n'))
    outcome = lmctl("run", box, "--sim", "--machine", "mapped.toml", "--operator", "Ada")
    assert outcome.code == 0, outcome.talk
