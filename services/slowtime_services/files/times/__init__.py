"""Times in files: stamps of dates, units of counted times, and the axis that they make."""
