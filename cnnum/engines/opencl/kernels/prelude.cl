// Number types: `scalar` in buffers, `real` in registers ($lanes frames side by side).
$pragma
typedef $scalar scalar;
typedef $real real;
#define LANES $lanes
#define R(value) ((real)(value))
#define ZERO R(0)
#define ONE R(1)
#define HUGE R($huge)
$lane_helpers
