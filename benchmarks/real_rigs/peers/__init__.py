"""Other tools: a model file and pieces of records → free runs on what was held out."""
