"""What is written to files and read from them: YAML documents, whole files."""
