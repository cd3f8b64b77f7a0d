"""Logs in forms of other programs: bags of ROS, data sets of LeRobot, files of identification tools."""
