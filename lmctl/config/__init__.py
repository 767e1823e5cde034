"""What people write: part files, machine profiles, materials; TOML in, checked models out."""
