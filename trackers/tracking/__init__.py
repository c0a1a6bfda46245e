"""Following targets over time, whatever they are measured by: moments, roster, lifecycle, association, appearance."""
