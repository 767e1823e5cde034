"""A simulated motion controller that speaks, plans and moves as Grbl 1.1h and grblHAL do.

`sim.MotionSimulator(config.MotionConfig(...))` is the controller on the running loop's clock;
`server.serve_tcp(sim, host, port)` and `server.open_pty(sim)` put it behind a wire;
`sim.trace` is the judge's exact record of what was executed.
"""
