"""The pydantic models of REST answers, for the OpenAPI document."""
