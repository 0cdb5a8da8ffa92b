"""Platforms on cables with mass, one at a time in MuJoCo: how they come to rest, and what it says there.

What ``batch`` and ``relaxation`` are for massless cables. Those would shake a chain (``chains``), whose masses are
light and whose springs are stiff. Here each step is implicit in all that is stiff (``stepping``). The platform takes
steps as long as its slowest swing allows (``relaxation``). Near rest they become longer than any swing (``approach``):
implicit in the whole stiffness, as MuJoCo shows it when everything is displaced a little (``derivatives``).
"""
