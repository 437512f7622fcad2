"""Published results to put beside ours: Lu, Cheng and Hu 2023, Table 2, mean ||e|| for t >= 10 s in m."""

TABLE_2: dict[str, dict[str, float]] = {
    "swap": {"u_t": 0.019, "u_s": 0.41},
    "thruster_gain": {"u_t": 0.028, "u_s": 0.39},
    "reversed": {"u_t": 0.021, "u_s": 1.16},
    "reversed_and_dead": {"u_t": 0.021, "u_s": 1.16},  # the text's version of scenario 3; Table 2 has one row for it
}
