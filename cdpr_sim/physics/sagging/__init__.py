"""Platforms on cables with mass in MuJoCo, side by side: settling, and the state after it.

This folder does for cables with mass what ``batch`` and ``dynamic_relaxation`` do for massless ones. Those would excite
a chain (``chains``), whose masses are small and whose springs are stiff. Here each step is implicit in all stiff
forces (``stepping``). The time step is limited by the slowest oscillation of the platform (``chain_relaxation``). Near
equilibrium the steps become longer than any oscillation (``approach``): implicit in the whole stiffness, which is
measured in MuJoCo by small displacements (``chain_derivatives``).

All rows of a robot move at the same time, each with its own time step: a row costs least with many beside it, and
MuJoCo computes rows on threads.
"""
