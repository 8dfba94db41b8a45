"""Messages, lines, frames and scans in; batches of numbers out."""
