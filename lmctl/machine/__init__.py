"""Drivers: motion over a byte link, feeders over Modbus. They know no job and no geometry."""
