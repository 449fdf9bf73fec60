#version 460
// Counted by a query, and nothing else.
void main() {}
