#include "cnnum_packet.h"

static uint16_t crc16(const uint8_t *data, size_t size)
{
    uint16_t rest = 0xFFFF;
    while (size--) {
        rest = (uint16_t)(rest ^ *data++ << 8);
        for (int bit = 0; bit < 8; bit++)
            rest = (uint16_t)(rest & 0x8000 ? rest << 1 ^ 0x1021 : rest << 1);
    }
    return rest;
}

static uint32_t crc32(const uint8_t *data, size_t size)
{
    uint32_t rest = 0xFFFFFFFF;
    while (size--) {
        rest ^= *data++;
        for (int bit = 0; bit < 8; bit++)
            rest = rest & 1 ? rest >> 1 ^ 0xEDB88320 : rest >> 1;
    }
    return ~rest;
}

static void put(uint8_t *at, uint64_t value, int bytes)
{
    for (int n = 0; n < bytes; n++)
        at[n] = (uint8_t)(value >> 8 * n);
}

size_t cnnum_payload_size(const struct cnnum_array *array)
{
    static const uint8_t bytes[] = {0, 1, 1, 2, 2, 4, 4};
    return (size_t)array->rows * array->cols * array->channels * bytes[array->cell];
}

size_t cnnum_packet_size(const struct cnnum_array *array)
{
    return CNNUM_HEADER + cnnum_payload_size(array) + CNNUM_TAIL;
}

void cnnum_packet_seal(uint8_t *packet, const struct cnnum_array *array, uint32_t sequence,
                       uint64_t time_us, uint8_t flags)
{
    const uint8_t head[12] = {0xC3, 'N', 'U', 'M', 1, array->rows, array->cols, array->channels,
                              array->cell, array->layout, array->unit, flags};
    size_t end = CNNUM_HEADER + cnnum_payload_size(array);
    for (int n = 0; n < 12; n++)
        packet[n] = head[n];
    put(packet + 12, sequence, 4);
    put(packet + 16, time_us, 8);
    put(packet + 24, array->period_us, 4);
    put(packet + 28, 0, 2);
    put(packet + 30, crc16(packet, 30), 2);
    put(packet + end, crc32(packet, end), CNNUM_TAIL);
}

void cnnum_put_u16(uint8_t *packet, size_t index, uint16_t value)
{
    put(packet + CNNUM_HEADER + 2 * index, value, 2);
}
