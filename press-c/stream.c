/* reads frames as they lie in memory, and writes their answers */
#include "press.h"

#include <stdio.h>

static press_memory memory;
static press_input input;
static press_output output;

int main(void)
{
    press_reset(&memory);
    while (fread(&input, sizeof input, 1, stdin) == 1) {
        press_step(&memory, &input, &output);
        if (fwrite(&output, sizeof output, 1, stdout) != 1) {
            return 1;
        }
    }
    return 0;
}
