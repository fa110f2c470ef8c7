// Votes as the published program does, to measure its loop beside this project's on one machine.
//
// Written from the paper (Algorithm 1, space sweep through the plane z0): the events of a packet
// share one pose; each is carried once to the plane z = z0 of the reference view, in pixels. A
// pixel u0 there meets depth z at u = (u0 a + b) / d, whose coefficients depend on the packet's
// camera centre and on z alone. Every plane then takes all packets one after another, an event at
// a time, and each vote is shared out among four pixels. Planes are shared out among threads.

#include <cstddef>
#include <cstdint>

namespace {

struct View {
    float fx, fy, cx, cy;
    int width, height;
};

inline bool vote(float *plane, const View &view, float u, float v) {
    if (!(u >= 0.f && v >= 0.f)) return false;
    const int column = static_cast<int>(u), row = static_cast<int>(v);
    if (column + 1 >= view.width || row + 1 >= view.height) return false;
    const float right = u - column, down = v - row;
    const float left = 1.f - right, up = 1.f - down;
    float *cell = plane + static_cast<std::ptrdiff_t>(row) * view.width + column;
    cell[0] += left * up;
    cell[1] += right * up;
    cell[view.width] += left * down;
    cell[view.width + 1] += right * down;
    return true;
}

}  // namespace

extern "C" {

// Carries events to the plane z = z0.
//
// x, y: (packets * per_packet) pixels. bearings: (rows, columns, 2), the ray (b_x, b_y, 1) of a
// pixel. poses: (packets, 12), rows of the 3 x 4 matrix from the camera to the reference view.
// at_z0: out, (packets * per_packet, 2), px. centres: out, (packets, 3), m.
void to_plane(const uint16_t *x, const uint16_t *y, int64_t packets, int per_packet,
              const double *bearings, int columns, const double *poses, View view, double z0,
              float *at_z0, float *centres) {
    for (int64_t packet = 0; packet < packets; ++packet) {
        const double *T = poses + 12 * packet;
        for (int axis = 0; axis < 3; ++axis) centres[3 * packet + axis] = T[4 * axis + 3];
        for (int64_t k = packet * per_packet; k < (packet + 1) * per_packet; ++k) {
            const double *b = bearings + 2 * (static_cast<int64_t>(y[k]) * columns + x[k]);
            double ray[3];
            for (int axis = 0; axis < 3; ++axis)
                ray[axis] = T[4 * axis] * b[0] + T[4 * axis + 1] * b[1] + T[4 * axis + 2];
            const double reach = (z0 - T[11]) / ray[2];
            at_z0[2 * k] = view.fx * (T[3] + reach * ray[0]) / z0 + view.cx;
            at_z0[2 * k + 1] = view.fy * (T[7] + reach * ray[1]) / z0 + view.cy;
        }
    }
}

// Fills volume (planes, height, width), which must be zero; returns how many votes counted.
int64_t cast_votes(const float *at_z0, const float *centres, int64_t packets, int per_packet,
                   const float *depths, int planes, View view, float z0, float *volume) {
    const std::ptrdiff_t pixels = static_cast<std::ptrdiff_t>(view.width) * view.height;
    int64_t counted = 0;
#pragma omp parallel for reduction(+ : counted)
    for (int plane = 0; plane < planes; ++plane) {
        float *grid = volume + plane * pixels;
        const float z = depths[plane];
        for (int64_t packet = 0; packet < packets; ++packet) {
            const float *C = centres + 3 * packet;
            const float a = z0 * (z - C[2]), d = z * (z0 - C[2]);
            const float b_u = (z0 - z) * (C[0] * view.fx + C[2] * view.cx);
            const float b_v = (z0 - z) * (C[1] * view.fy + C[2] * view.cy);
            const float *event = at_z0 + 2 * packet * per_packet;
            for (int k = 0; k < per_packet; ++k, event += 2)
                counted += vote(grid, view, (event[0] * a + b_u) / d, (event[1] * a + b_v) / d);
        }
    }
    return counted;
}
}
