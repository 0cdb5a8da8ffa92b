"""Platforms on cables with mass in MuJoCo, one at a time: settling, and the state after it.

This folder does for cables with mass what ``batch`` and ``dynamic_relaxation`` do for massless ones. Those would excite
a chain (``chains``), whose masses are small and whose springs are stiff. Here each step is implicit in all stiff
forces (``stepping``). The time step is limited by the slowest oscillation of the platform (``chain_relaxation``). Near
equilibrium the steps become longer than any oscillation (``approach``): implicit in the whole stiffness, which is
measured in MuJoCo by small displacements (``chain_derivatives``).
"""
