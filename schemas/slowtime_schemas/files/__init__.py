"""The files that slowtime reads and writes, as pydantic models with frozen schemas."""
