"""Where does a promise break, and what breaks it? Laws climb from equations to a machine."""
