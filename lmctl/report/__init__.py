"""Job logs: from journals and job files to tables people read."""
