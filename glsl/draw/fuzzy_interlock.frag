#version 460
#extension GL_ARB_fragment_shader_interlock : require
// `fuzzy` where attachments cannot be read in order, but fragments can take turns.
layout(pixel_interlock_ordered) in;
#define BEGIN beginInvocationInterlockARB()
#define END endInvocationInterlockARB()
#include "interlock.glsl"
