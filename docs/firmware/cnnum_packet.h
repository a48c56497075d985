/* The open serial protocol, version 1, for the array's side: see docs/serial-protocol.md.
 *
 * Plain C99, no heap, no floating point. The caller fills the cells and sends cnnum_packet_size()
 * bytes. With -DCNNUM_CRC_TABLES the checks take tables of 96 bytes and fewer instructions. */
#ifndef CNNUM_PACKET_H
#define CNNUM_PACKET_H

#include <stddef.h>
#include <stdint.h>

enum { CNNUM_HEADER = 32, CNNUM_TAIL = 4 };
enum cnnum_cell { CNNUM_U8 = 1, CNNUM_I8, CNNUM_U16, CNNUM_I16, CNNUM_I32, CNNUM_F32 };
enum cnnum_layout { CNNUM_UNNAMED = 0, CNNUM_NORMAL, CNNUM_FORCE, CNNUM_BRIDGES };
enum cnnum_unit { CNNUM_COUNT = 0, CNNUM_VOLT, CNNUM_NEWTON, CNNUM_PASCAL, CNNUM_STRAIN };
enum cnnum_flags { CNNUM_SATURATED = 1 };

/* What stays the same from scan to scan. */
struct cnnum_array {
    uint8_t rows, cols, channels, cell, layout, unit;
    uint32_t period_us; /* 0 if it is not known */
};

/* Bytes of the cells, and of a whole packet. */
size_t cnnum_payload_size(const struct cnnum_array *array);
size_t cnnum_packet_size(const struct cnnum_array *array);

/* Write header and checks around the cells, which stand from packet + CNNUM_HEADER on already, in
 * little-endian order. The sequence counts every scan that the array makes, sent or not. */
void cnnum_packet_seal(uint8_t *packet, const struct cnnum_array *array, uint32_t sequence,
                       uint64_t time_us, uint8_t flags);

/* Put one cell of 16 bits: four bridge counts a taxel, row by row. */
void cnnum_put_u16(uint8_t *packet, size_t index, uint16_t value);

#endif
