"""Diagnosis where the load is known in sum only: a force shoe's f_z, m_x and m_y."""
