"""Running a job: stream, lead the powder, watch, journal. Knows no geometry."""
