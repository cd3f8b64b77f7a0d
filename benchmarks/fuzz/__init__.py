"""Fuzzing of everything that is read from outside: ``python -m benchmarks.fuzz --kind csv --cases 100000``.

Good files are mutated byte by byte, line by line and number by number. Every case must end in a good read, or in the
reader's own refusal: one line that names the file and a remedy. No other exception, no hang, no memory blow-up, no
file left behind. Cases run in batches in a process of their own with a memory limit; an input that was refused for a
new reason joins the batch's corpus, with ``--coverage`` also one that reached a new line of mrwarp. Batch k of a seed
is always the same, and the state file lets a run go on where it stopped. What fails is kept in ``OUT/failures``.
"""
