"""Tables as people have them: read block by block, told apart by their columns, cut into rows that can be used.

Read :mod:`~auv_torchrl.flightlog.tables.header` and :mod:`~auv_torchrl.flightlog.tables.table` first, then
:mod:`~auv_torchrl.flightlog.tables.cells`, :mod:`~auv_torchrl.flightlog.tables.columns` and
:mod:`~auv_torchrl.flightlog.tables.rows`.
"""
