        // $method: at most $count steps of $step, a lane stops where nothing changes any more
        real running = ONE, time = ZERO, steps = ZERO, settled = ZERO;
        for (int n = 0; n < $count && ANY_LANE(running); ++n) {
            const real h = running * $h;
            real change = ZERO;
$step_text
            time += h;
            steps += running;
            settled = PICK(change <= ONE, ONE, settled);
            running = PICK(change <= ONE, ZERO, running);
        }
