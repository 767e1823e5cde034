"""From a part to a job: layers, paths, times, powder. Synchronous array code, no devices."""
