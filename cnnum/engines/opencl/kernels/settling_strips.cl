        // $method, by strips: at most $count steps of $step, until nothing changes any more
        real running = ONE, steps = ZERO, settled = ZERO;
        strip_control[2] = ZERO;
        ${strips}_begin;
        for (int n = 0; n < $rounds && ANY_LANE(running); ++n) {
            int taken = min($most, $count - (int)steps);
            int levels = taken * $stages;
            strip_control[0] = R(levels);
            strip_control[2] = steps;
            $strips;
            // the first step at whose start nothing changes is the last
            int at = 0;
            real changes = ONE;
            while (at < taken && changes != ZERO) {
                changes = ZERO;
                for (int k = 0; k < (int)strip_control[1] * $width; ++k) {
                    changes = fmax(changes, strip_changes[at * $each + k]);
                }
                ++at;
            }
            steps += R(at);
            settled = ONE - changes;
            running = PICK(steps < R($count), changes, ZERO);
            levels = at * $stages;
            strip_control[0] = R(levels);
            if (at < taken) {
                ${strips}_again;
            }
        }
        ${strips}_end;
