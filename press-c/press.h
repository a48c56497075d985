/* Program 'press' on 4 x 4 cells.
   Memory 4 bytes, frame 32, answers 4, tables 0.
   in_normal: -64 to 63.998; beyond that it saturates.
   5 of 5 values cannot leave their formats; 0 saturate. (ranges.txt)
   q15, method auto, by cnnum 0.1.0. */
#ifndef PRESS_H
#define PRESS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PRESS_ROWS 4
#define PRESS_COLS 4
/* a whole number q stands for q times 2^-FRACTION */
#define PRESS_IN_NORMAL_FRACTION 9
#define PRESS_OUT_DEEPEST_FRACTION 20
/* the range of an input: numbers beyond it are taken as its end */
#define PRESS_IN_NORMAL_LEAST (-32768)
#define PRESS_IN_NORMAL_LARGEST 32767

typedef struct { /* one frame: 32 bytes */
    int16_t in_normal[16]; /* channel normal: times 2^-9 */
} press_input;

typedef struct { /* its answers: 4 bytes */
    int32_t out_deepest; /* deepest: times 2^-20 */
} press_output;

typedef struct { /* what is kept and worked in: 4 bytes */
    int32_t started;
} press_memory;

/* before the first frame of a stream */
void press_reset(press_memory *m);

/* one frame */
void press_step(press_memory *m, const press_input *in, press_output *out);

#ifdef __cplusplus
}
#endif

#endif
