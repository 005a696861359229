"""What a verdict is: certificates, the evidence in them, and their files."""
