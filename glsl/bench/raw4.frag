#version 460
#define ATTACHMENTS 4
#include "raw_color.glsl"
