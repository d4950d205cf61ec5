import subprocess,resource,time,json,shutil,os,statistics,sys
B=os.environ.get('LENSCUBE','lenscube')
S=['--sensor','d/example-2um.toml','--exposure','5ms']
near=['--set','crosstalk.file=near.csv']
dif=['--set','crosstalk.diffusion_length_um=10','--set','crosstalk.depletion_um=3']
bl=['--set','pixel.blooming=1','--set','pixel.knee=0.9']
de=['--set','defects.hot_pixels=1e-4','--set','defects.hot_dark_e_per_s=2000','--set','defects.telegraph_pixels=1e-3','--set','defects.telegraph_e=10']
sh=['--set','shutter.row_time_us=5','--flicker','100:0.3']
C={'none':[], 'table':near,'diffusion':dif,'blooming':bl,'defects':de,'flicker':sh,'all':near+dif+bl+de+sh}
out={k:[] for k in C}
for i in range(int(sys.argv[1])):
    for k,a in C.items():
        shutil.rmtree('o.zarr',ignore_errors=True)
        t=time.time()
        p=subprocess.Popen([B,'sensor','film.zarr','o.zarr',*S,*a,'-q'],stderr=subprocess.PIPE)
        _,st,r=os.wait4(p.pid,0)
        if st: print(k,p.stderr.read())
        out[k].append((time.time()-t,r.ru_utime+r.ru_stime,r.ru_maxrss/1024))
for k,v in out.items(): print(k,[round(statistics.median(x),2) for x in zip(*v)])
json.dump(out,open('out.json','w'))
