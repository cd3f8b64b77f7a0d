"""The device in other languages: a C header, a file of Python with NumPy alone, joints of plain MuJoCo."""
