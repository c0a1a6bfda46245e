"""Pages of the documentation: what is built, the figures that they show, and the code blocks that the tests run."""
