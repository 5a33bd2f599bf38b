"""The trace of a run in the formats of the field's tools.

``bussim export RUN_DIR --to FORMAT`` writes them; :func:`bussim.export.formats.export_trace` is the same in
Python. A format needs the trace (``bussim run --trace``) and nothing else of the run.

The formats stand in :data:`bussim.export.formats.FORMATS`, each with its writer and what reads it.

**Wireshark.** Each bus is an interface; its link type names the protocol: 147 (USER0) Modbus
RTU, 148 (USER1) N:N, 149 (USER2) Modbus ASCII, 150 (USER3) free protocol.

- Modbus RTU needs one preference and no plug-in. *Edit > Preferences > Protocols > DLT_USER*, or::

      tshark -o 'uat:user_dlts:"User 0 (DLT=147)","mbrtu","0","","0",""' -r trace.pcapng

  With ``--encap udp`` the frames are wrapped in UDP (port 5020), which says what is a
  request: only so can Wireshark distinguish the response to a write from its request, and show broadcasts::

      tshark -o mbrtu.udp.port:5020 -r trace.pcapng

  ``-o mbrtu.crc_verification:TRUE`` (the box *Validate CRC*) checks each frame's CRC.
- N:N and Modbus ASCII are read by two dissectors in Lua, which are files of this package; load them
  with ``-X lua_script:…/bussim/export/nn.lua`` or put them into Wireshark's plug-in folder.

Frames that were damaged, collided or were cut off carry a comment (``frame.comment``) and, where a
character's parity or stop bit was wrong, the packet flag "symbol error". Times count from 1970.

**PulseView.** Open the ``.sr`` (or import the ``.vcd``), add the decoder *UART* on the bus's lane with
its rate and format (N:N: 38400, 7 data bits, even parity, 1 stop bit). For Modbus give the *UART* the
lane of the slave as RX and the master's as TX, and stack *Modbus* on it: so it knows
the requests. On the command line::

    sigrok-cli -i trace.sr -P uart:rx=link:baudrate=38400:data_bits=7:parity=even -A uart=rx-data
    sigrok-cli -i trace.sr -P uart:rx=oven1:tx=press2.COM5:baudrate=19200:parity=even,modbus -A modbus

One sample is 1 µs. A ``.vcd`` counts from the run's start, a ``.sr`` from the window's.

**Perfetto.** Open the ``.json`` at https://ui.perfetto.dev (it stays in the browser).
"""
