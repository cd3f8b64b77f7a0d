"""The method of identification, once: from linearised pieces of a recording to proven causes.

The files read in this order:

* :mod:`~mrwarp.sysid.pieces`: the data, a quadratic form per piece with its nuisances removed;
* :mod:`~mrwarp.sysid.least_squares`: numbers fitted to them within bounds;
* :mod:`~mrwarp.sysid.left_out`: each piece predicted by the others;
* :mod:`~mrwarp.sysid.jackknife`: intervals with pieces as the units of chance;
* :mod:`~mrwarp.sysid.plant`: what the method asks of a plant;
* :mod:`~mrwarp.sysid.stepwise`: a set of causes grown, and what is not certain taken out of it;
* :mod:`~mrwarp.sysid.certainty`: tests that a cause must pass before it is named;
* :mod:`~mrwarp.sysid.verdict`: the answer;
* :mod:`~mrwarp.sysid.report.page`: the page that says it.

A *plant* brings what is physical: a replay, its derivatives, its nuisances, and causes with their bounds. The joint is
one, :class:`mrwarp.diagnose.search.JointSearch`, a whole robot another,
:class:`mrwarp.robot_logs.selection.RobotSearch`. A third, a spring with friction, is ``tests/sysid/spring.py``.
"""
