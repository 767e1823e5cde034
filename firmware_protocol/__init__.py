"""Both ends of the motion protocol and the register maps; standard library only."""
