"""Orders of diagnoses in; jobs, their results and adopted models out."""
