#include "cnnum_packet.h"

#ifdef CNNUM_CRC_TABLES /* four bits at a time */

static uint16_t crc16(const uint8_t *data, size_t size)
{
    static const uint16_t table[16] = {
        0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
        0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
    };
    uint16_t rest = 0xFFFF;
    while (size--) {
        rest = (uint16_t)(rest << 4 ^ table[rest >> 12 ^ *data >> 4]);
        rest = (uint16_t)(rest << 4 ^ table[rest >> 12 ^ (*data++ & 15)]);
    }
    return rest;
}

static uint32_t crc32(const uint8_t *data, size_t size)
{
    static const uint32_t table[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC,
        0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
        0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
        0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    uint32_t rest = 0xFFFFFFFF;
    while (size--) {
        rest = rest >> 4 ^ table[(rest ^ *data) & 15];
        rest = rest >> 4 ^ table[(rest ^ (uint32_t)*data++ >> 4) & 15];
    }
    return ~rest;
}

#else /* bit by bit */

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

#endif

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
