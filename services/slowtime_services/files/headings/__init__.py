"""Lines of a heading in; rate, interval, count, duration, start and unit out."""
