"""The rules by which set-points follow the flow wanted: planning predicts what running will send.

`lmctl.run.powder.lead` applies them, `lmctl.plan.sequence.held_setpoints` predicts the result.
"""

from __future__ import annotations

#: How often set-points are sent, and so how long each holds at least [s].
SETPOINT_PERIOD_S = 0.1

#: Feeders take set-points in steps of 0.01 g/min (docs/explanation/powder-delivery.md, Feeders).
FLOW_DECIMALS = 2

#: Outflow may stray so far from what is wanted before a new set-point is worth a telegram: a share
#: of it, but not less than [g/min]. A hopper 1.5 % off moves a fraction by less than 0.004, where
#: compositions are planned in steps of 0.02. At a third of it the scanned gear takes 1.7 times as
#: many telegrams, and its composition is no nearer where it counts (99 % within 0.006).
OUTFLOW_TOLERANCE_FRACTION = 0.015
MIN_OUTFLOW_TOLERANCE_G_MIN = 0.04

#: Share of the slack that a new set-point is to use: rounding, and a clock corrected by a few
#: milliseconds, take the rest.
CHOSEN_WITHIN = 0.9

#: Most ticks a set-point is chosen to last; it is held longer where it still fits.
MAX_HOLD_TICKS = 16

#: However steady the flow, set-points are looked at once in so many ticks.
MAX_TICKS = 50

#: By no more than this does a report set the clock forward [s].
CLOCK_MARGIN_S = 0.5
