"""An oscillator of a single degree of freedom in; its response out."""
