"""Is this the machine, in the state, that the program may be sent to?"""

from __future__ import annotations

from lmctl.config.machine import MachineProfile
from lmctl.errors import MachineError
from lmctl.machine.identify import MOST_SPINDLE
from lmctl.machine.motion import MotionDriver
from lmctl.run.cell import is_idle


def check_motion(motion: MotionDriver, profile: MachineProfile) -> None:
    """Raise MachineError where full power differs from the profile's, or it is not ready.

    ($32 and $10 were judged when the link was opened.)
    """
    place = f"motion controller at {profile.motion.endpoint}"
    stated = motion.settings.get(MOST_SPINDLE, "missing")
    s_max = profile.laser.s_max
    if not _is_number(stated, s_max):
        raise MachineError(
            f"full power is S{stated} on the controller (${MOST_SPINDLE}), but S{s_max} in the "
            "profile: every power would be wrong",
            where=place,
            hint=f"send ${MOST_SPINDLE}={s_max} to the controller, or correct laser.s_max",
        )
    if not is_idle(motion.status):
        state = "unknown" if motion.status is None else motion.status.state
        raise MachineError(
            f"the motion controller is not ready: its state is {state}", where=place,
            hint="find the reason, then unlock ($X) or home ($H) it at its panel, and try again",
        )


def _is_number(text: str, value: float) -> bool:
    try:
        return float(text) == value
    except ValueError:
        return False
