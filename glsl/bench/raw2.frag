#version 460
#define ATTACHMENTS 2
#include "raw_color.glsl"
