/* A sketch of an array's firmware: four bridge counts a taxel, N scans, to standard output.
 *
 * On a processor, read_bridge() reads the converter, send() fills the port's buffer, and micros()
 * is a timer; none of them may wait. A scan whose buffer is full is left out, and its number with
 * it, so that the host counts it as dropped. */
#include <stdio.h>
#include <stdlib.h>

#include "cnnum_packet.h"

enum { SIDES = 4, MOST = 8 };

static uint16_t read_bridge(int row, int col, int side, uint32_t scan)
{
    return (uint16_t)(2048u + 64u * (uint32_t)row + 8u * (uint32_t)col + (uint32_t)side + scan % 16u);
}

static int send(const uint8_t *data, size_t size)
{
    return fwrite(data, 1, size, stdout) == size;
}

int main(int count, char **words)
{
    int rows = count > 1 ? atoi(words[1]) : MOST, cols = count > 2 ? atoi(words[2]) : MOST;
    uint32_t scans = count > 3 ? (uint32_t)strtoul(words[3], NULL, 10) : 10;
    uint32_t period = count > 4 ? (uint32_t)strtoul(words[4], NULL, 10) : 1000;
    static uint8_t packet[CNNUM_HEADER + 2 * MOST * MOST * SIDES + CNNUM_TAIL];
    if (rows < 2 || rows > MOST || cols < 2 || cols > MOST)
        return 2;
    const struct cnnum_array array = {(uint8_t)rows, (uint8_t)cols, SIDES, CNNUM_U16,
                                      CNNUM_BRIDGES, CNNUM_COUNT,   period};
    for (uint32_t scan = 0; scan < scans; scan++) {
        size_t at = 0;
        for (int row = 0; row < rows; row++)
            for (int col = 0; col < cols; col++)
                for (int side = 0; side < SIDES; side++)
                    cnnum_put_u16(packet, at++, read_bridge(row, col, side, scan));
        cnnum_packet_seal(packet, &array, scan, (uint64_t)scan * period, 0);
        if (!send(packet, cnnum_packet_size(&array)))
            return 1;
    }
    return 0;
}
