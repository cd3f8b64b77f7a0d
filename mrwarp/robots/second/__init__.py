"""A robot's file read a second time, without the code of the first reading, and the two compared."""
