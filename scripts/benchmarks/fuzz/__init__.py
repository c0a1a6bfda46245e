"""The mutation run: real inputs of every kind with something hostile in them, each judged by what the twin makes of it.

`values` corrupts values, text and bytes; `inputs` makes the real inputs once; `kinds` makes a mutant of each kind from a seed;
`judge` runs it in a `child` process and says what was wrong with how it was handled; `figures` counts.
"""
