"""Checked YAML and JSON files in; problems of design and reliability out."""
