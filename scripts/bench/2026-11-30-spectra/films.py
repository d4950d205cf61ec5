"""Jobs of three or more programs in turn: medians of wall and core seconds, peak MiB. films.py ROUNDS NAME=PROGRAM… -- CASE…"""
import json, os, pathlib, shutil, statistics, subprocess, sys, time
rounds = int(sys.argv[1]); cut = sys.argv.index('--')
programs = dict(a.split('=') for a in sys.argv[2:cut]); cases = sys.argv[cut+1:]
W = pathlib.Path('/tmp/tbl'); W.mkdir(exist_ok=True)
def timed(env, *args):
    t = time.monotonic()
    p = subprocess.Popen(list(map(str, args)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=env)
    text = p.stderr.read(); _, status, u = os.wait4(p.pid, 0)
    if status: print(args, text.decode()[-600:], file=sys.stderr); return None
    return time.monotonic() - t, u.ru_utime + u.ru_stime, u.ru_maxrss / 1024
def job(case, film, env):
    m = ['--memory', '1GiB']
    if case == 'drawn': return ['run', 'gen:composite?size=14141', film, *m]
    if case == 'store': return ['run', W/'chart.zarr', film, *m]
    if case == 'fast-fifty': return ['run', 'gen:siemens?size=1300x900', film, '--lens', 'fast-fifty', '--film-size', '1200x800']
    if case == 'phone': return ['run', 'gen:composite?size=2600x1950&pitch_um=1.2', film, '--lens', 'phone', *m]
    if case == 'small': return ['run', 'gen:composite?size=256&wavelengths=450:650:100', film, *m]
for case in cases:
    found = {n: [] for n in programs}
    for n, p in programs.items():  # traces into the cache
        env = {**os.environ, 'XDG_CACHE_HOME': str(W/f'cache-{n}')}
        film = W/f'{n}.zarr'; shutil.rmtree(film, ignore_errors=True)
        timed(env, p, *job(case, film, env))
    for _ in range(rounds):
        for n, p in programs.items():
            env = {**os.environ, 'XDG_CACHE_HOME': str(W/f'cache-{n}')}
            film = W/f'{n}.zarr'; shutil.rmtree(film, ignore_errors=True)
            subprocess.run(['sync'])
            if case == 'store': subprocess.run('sync; echo 3 > /proc/sys/vm/drop_caches', shell=True)
            r = timed(env, p, *job(case, film, env)); shutil.rmtree(film, ignore_errors=True)
            if r: found[n].append(r)
    for n, runs in found.items():
        if runs: print(json.dumps({'case': case, 'program': n, 'wall_s': [round(r[0],2) for r in runs], 'median': [round(statistics.median(c),2) for c in zip(*runs)]}), flush=True)
