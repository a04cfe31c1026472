"""How the world moves: currents, obstacles, energy, vehicle."""
