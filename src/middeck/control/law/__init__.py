"""What a control law is: compensators, ports, parts that nothing moves, orders of delays, uncertainty."""
