"""The library of identified devices: numbers with intervals, their range and error, and the page that shows them."""
