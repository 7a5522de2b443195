"""The Patient Side Manipulator (PSM) of the da Vinci Research Kit: kinematics and simulated arm."""
