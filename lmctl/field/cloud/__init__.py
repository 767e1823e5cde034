"""From measured points to a field: neighbours, fitted patches, inside and outside."""
