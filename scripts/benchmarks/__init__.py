"""The figures the project promises, each measured by one function."""
