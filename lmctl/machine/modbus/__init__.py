"""Modbus TCP and RTU, over pymodbus."""
