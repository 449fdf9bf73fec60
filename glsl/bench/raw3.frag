#version 460
#define ATTACHMENTS 3
#include "raw_color.glsl"
