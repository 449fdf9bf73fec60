#version 460
// The same without the critical section, for the tests of a device that needs none (`Interlock::Implicit`).
#define BEGIN
#define END
#include "interlock.glsl"
