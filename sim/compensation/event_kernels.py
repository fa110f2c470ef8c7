"""Events of one camera between two key frames: compiled; steps no finer than thresholds ask for."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from sim.compensation.light_kernels import cubic_light, linear_light
from sim.compensation.path_kernels import bent, carried
from sim.sensor.esim_kernels import NEAR, level_of, number_of_falls, number_of_rises


@numba.njit(cache=True, nogil=True, inline="always")
def look(light, u, v, cubic):
    if cubic:
        return cubic_light(light, u, v)
    return linear_light(light, u, v)


@numba.njit(cache=True, nogil=True)
def events_between(
    light_a, light_b, rho_a, rho_b, body_a, body_b, ways, bearing, lens, grid, margin,
    low, high, near_low_a, near_high_a, near_low_b, near_high_b, slope_a, slope_b,
    memory, reference, rise_light, fall_light, c_pos, c_neg, log_eps,
    before_us, step_us, refractory_us, least_px, most_px, cubic, refine, skip1, counts,
):
    height, width = rho_a.shape
    ch, cw = slope_a.shape
    room = 4096
    pixel, offset_us, p = np.empty(room, np.int32), np.empty(room, np.int64), np.empty(room, np.uint8)
    n = 0
    for y in range(height):
        for x in range(width):
            k = y * width + x
            rise, fall = rise_light[k], fall_light[k]
            if high[y, x] < rise and low[y, x] > fall:
                continue
            counts[0] += 1
            a, b = np.float64(bearing[y, x, 0]), np.float64(bearing[y, x, 1])
            ra, rb = np.float64(rho_a[y, x]), np.float64(rho_b[y, x])
            ga, gb = body_a[y, x], body_b[y, x]
            # in A: 0 at the start, through the middle, to the end; in B: the other way round
            au, av = carried(ways[gb, 1], a, b, rb, lens)
            bu, bv = carried(ways[ga, 3], a, b, ra, lens)
            if ga == gb:
                rm = 0.5 * (ra + rb)
                hau, hav = carried(ways[ga, 0], a, b, rm, lens)
                hbu, hbv = carried(ways[ga, 2], a, b, rm, lens)
            else:
                u1, v1 = carried(ways[ga, 0], a, b, ra, lens)
                u2, v2 = carried(ways[gb, 0], a, b, rb, lens)
                hau, hav = 0.5 * (u1 + u2), 0.5 * (v1 + v2)
                u1, v1 = carried(ways[ga, 2], a, b, ra, lens)
                u2, v2 = carried(ways[gb, 2], a, b, rb, lens)
                hbu, hbv = 0.5 * (u1 + u2), 0.5 * (v1 + v2)
            au1, au2 = bent(au - x, hau - x)
            av1, av2 = bent(av - y, hav - y)
            bu1, bu2 = bent(bu - x, hbu - x)
            bv1, bv2 = bent(bv - y, hbv - y)
            way = max(math.sqrt((au - x) ** 2 + (av - y) ** 2), math.sqrt((bu - x) ** 2 + (bv - y) ** 2))
            per_px = 1.0 / max(way, 1e-6)
            least, most = least_px * per_px, most_px * per_px
            s = 0.0
            now = np.float64(light_a[grid * (y + margin), grid * (x + margin)])
            last = np.float64(light_b[grid * (y + margin), grid * (x + margin)])
            ua, va, ub, vb = float(x), float(y), bu, bv
            la = lb = now
            while s < 1.0:
                ja, ia = min(max(int(ua) + margin, 0), cw - 1), min(max(int(va) + margin, 0), ch - 1)
                jb, ib = min(max(int(ub) + margin, 0), cw - 1), min(max(int(vb) + margin, 0), ch - 1)
                far = min(rise - now, now - fall)
                if far > 0:
                    slope = max(slope_a[ia, ja], slope_b[ib, jb])
                    step = far / (slope / per_px + abs(la - lb) + 1e-9)
                    step = min(max(step, least), most)
                else:
                    step = least
                if skip1 and step < per_px:
                    if max(near_high_a[ia, ja], near_high_b[ib, jb]) < rise and min(near_low_a[ia, ja], near_low_b[ib, jb]) > fall:
                        step = per_px
                then = s + step
                if then > 1.0 - 0.5 * least:
                    then = 1.0
                    light = last
                else:
                    counts[1] += 1
                    back = 1.0 - then
                    ua, va = x + then * (au1 + au2 * then), y + then * (av1 + av2 * then)
                    ub, vb = x + back * (bu1 + bu2 * back), y + back * (bv1 + bv2 * back)
                    la = look(light_a, grid * (ua + margin), grid * (va + margin), cubic)
                    lb = look(light_b, grid * (ub + margin), grid * (vb + margin), cubic)
                    light = back * la + then * lb
                if light >= rise or light <= fall:
                    first = np.float64(memory[k].first_log)
                    up, down = memory[k].up, memory[k].down
                    log0, log1 = math.log(now + log_eps), math.log(light + log_eps)
                    rising = light >= rise
                    if rising:
                        number = number_of_rises(log1, first, up, down, c_pos, c_neg)
                    else:
                        number = number_of_falls(log1, first, up, down, c_pos, c_neg)
                    for _ in range(number):
                        if rising:
                            up += 1
                        else:
                            down += 1
                        level = level_of(first, up, down, c_pos, c_neg)
                        share = min(max((level - log0) / (log1 - log0), 0.0), 1.0)
                        when = s + share * (then - s)
                        if refine and (then - s) > 0.02 * per_px:
                            counts[2] += 1
                            back = 1.0 - when
                            u1, v1 = x + when * (au1 + au2 * when), y + when * (av1 + av2 * when)
                            u2, v2 = x + back * (bu1 + bu2 * back), y + back * (bv1 + bv2 * back)
                            m = back * look(light_a, grid * (u1 + margin), grid * (v1 + margin), cubic)
                            m += when * look(light_b, grid * (u2 + margin), grid * (v2 + margin), cubic)
                            logm = math.log(m + log_eps)
                            if (logm >= level) == rising:
                                if logm != log0:
                                    when = s + min(max((level - log0) / (logm - log0), 0.0), 1.0) * (when - s)
                            elif log1 != logm:
                                when = when + min(max((level - logm) / (log1 - logm), 0.0), 1.0) * (then - when)
                        offset = min(max(int(np.rint(when * step_us)), 1), step_us)
                        if before_us + offset - memory[k].last_emitted_us < refractory_us:
                            counts[3] += 1
                            continue
                        memory[k].last_emitted_us = before_us + offset
                        if n == room:
                            room *= 2
                            bp, bo, bq = np.empty(room, np.int32), np.empty(room, np.int64), np.empty(room, np.uint8)
                            bp[:n], bo[:n], bq[:n] = pixel, offset_us, p
                            pixel, offset_us, p = bp, bo, bq
                        pixel[n], offset_us[n], p[n] = k, offset, rising
                        n += 1
                    if number:
                        memory[k].up, memory[k].down = up, down
                        reference[k] = level_of(first, up, down, c_pos, c_neg)
                        rise = math.exp(reference[k] + c_pos - NEAR) - log_eps
                        fall = math.exp(reference[k] - c_neg + NEAR) - log_eps
                        rise_light[k], fall_light[k] = rise, fall
                now, s = light, then
    return pixel[:n], offset_us[:n], p[:n]
