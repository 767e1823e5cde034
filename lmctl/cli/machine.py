"""`lmctl machine`: looking at a cell, checking and measuring it, and moving it by hand."""

from __future__ import annotations

import click

from lmctl.cli.lazy import LazyGroup

COMMANDS = {
    "status": ("lmctl.cli.machine_inspection", "One look at every device. Nothing is moved."),
    "doctor": ("lmctl.cli.machine_inspection",
               "Check every condition of a run, and say what to do."),
    "home": ("lmctl.cli.machine_actions", "Home the axes."),
    "jog": ("lmctl.cli.machine_actions", "Move the axes by hand, without beam."),
    "offset": ("lmctl.cli.machine_actions",
               "Say where program zero is; show or clear work offsets."),
    "settings": ("lmctl.cli.machine_settings",
                 "Show, keep, compare and write the firmware's settings."),
    "feeder-test": ("lmctl.cli.machine_measuring",
                    "Step hoppers over the catch scale, beam off; measure how they respond."),
    "catch-test": ("lmctl.cli.machine_coupons",
                   "Lay coupons and weigh them; measure how much powder stays on a part."),
    "dilution-test": ("lmctl.cli.machine_coupons",
                      "Lay tracks and cut them; measure how much of the plate they take up."),
    "devices-xml": ("lmctl.cli.machine_mtconnect",
                    "Describe the cell for an MTConnect agent (Devices.xml)."),
    "unlock": ("lmctl.cli.machine_actions", "End latched alarms of controller and feeders."),
}


@click.command(cls=LazyGroup, table=COMMANDS)
def machine() -> None:
    """Look at a machine, check it, home it, jog it, unlock it, measure it.

    Name the machine by --machine FILE, or take the simulated one by --sim.
    """
