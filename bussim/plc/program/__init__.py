"""PLC programs: FX instruction lists, checked, compiled once and carried out scan by scan.

``source`` reads a text into instructions (``operands``, ``catalog``), ``check`` and ``ladder`` check
them and find their networks, ``build`` and the modules of instructions bind them to a memory, ``run``
carries them out. The semantics are those of the FX programming manual (JY992D88101) where a comment
says nothing else.
"""
