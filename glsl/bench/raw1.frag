#version 460
#define ATTACHMENTS 1
#include "raw_color.glsl"
