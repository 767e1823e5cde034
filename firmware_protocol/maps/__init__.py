"""Register maps that ship, as files: `firmware_protocol.map_file.shipped_map` reads them."""

__all__: list[str] = []
