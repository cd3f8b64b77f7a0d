"""Studies of section 6.2 on trained policies: tables 2 and 3 and the learning curves of figure 5.

``plan`` names the policies and their files, ``training`` trains and collects them, ``rollouts`` rolls many out side by
side, ``tables`` gives ``table2(EvaluationCfg())`` and ``table3(EvaluationCfg())`` as dataclasses, ``causes`` the
velocity error on plants between Go1 and MR_Go, ``curves`` figure 5.
"""
