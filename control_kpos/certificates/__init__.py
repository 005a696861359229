"""What a verdict is: proven signs, certificates, and their files."""
