"""Cost of SVPSF blocks of any two sides on the node grids of a lens, by the cost model of pipeline/src/psf/blocks.rs.

    lenscube lens trace double-gauss-28 dg400.lens.zarr --wavelengths 400
    python shapes.py dg400.lens.zarr 147 dg550.lens.zarr 41 dg700.lens.zarr 55

Each pack is followed by the side of its PSFs in film pixels of 2 µm. A node counts in a block if one of 20 x 20 points of the block is in one of
its four cells. 400 blocks at random places of a film of 14141 x 14141 px. Needs numpy and zarr.
"""
import numpy, zarr, sys

# FFT side: ns a transformed pixel of each node, and of each block.
SIDES={64:(.63,.95),96:(.70,.95),128:(.70,1.15),160:(.88,1.35),192:(.86,1.20),256:(.98,1.40),320:(1.27,1.40),384:(1.5,1.6),480:(1.68,1.9),512:(1.68,1.9),640:(2.1,2.2)}
rng=numpy.random.default_rng(1)
def load(path):
    g=zarr.open_group(path,mode='r')
    names=list(g.array_keys())
    h=g['psf_height'][:].ravel(); a=g['azimuth_count'][:].ravel()
    keep=numpy.isfinite(h); return h[keep],a[keep].astype(int)
def touched(h_px,az,x0,y0,w,hh):
    u=numpy.linspace(0,1,20)
    x=(x0+u*w)[None,:]; y=(y0+u*hh)[:,None]
    r=numpy.hypot(x,y).ravel(); t=numpy.mod(numpy.arctan2(y+0*x,x+0*y).ravel(),2*numpy.pi)
    k=numpy.clip(numpy.searchsorted(h_px,r)-1,0,len(h_px)-2)
    s=set()
    for ring in (k,k+1):
        j=numpy.floor(t/(2*numpy.pi/az[ring])).astype(int)
        for d in (0,1): s.update(numpy.unique(ring*100000+(j+d)%az[ring]))
    return len(s)
for pack,n in zip(sys.argv[1::2],map(int,sys.argv[2::2])):
    h,az=load(pack); h=h/2e-3
    print(pack,'window',n,'rings',len(h),'nodes',az.sum(), 'ring step px', numpy.diff(h).min().round(), numpy.diff(h).max().round(), 'arc px', (2*numpy.pi*h[1:]/az[1:]).min().round(),(2*numpy.pi*h[1:]/az[1:]).max().round())
    best={}
    pos=rng.uniform(-7070,7070,(400,2))
    for fx in SIDES:
        for fy in SIDES:
            vx,vy=fx-n+1,fy-n+1
            if vx<n//2 or vy<n//2: continue
            K=numpy.array([touched(h,az,x,y,vx,vy) for x,y in pos])
            a=(fx*fy)**.5
            node,once=[numpy.interp(a,list(SIDES),[v[i] for v in SIDES.values()]) for i in (0,1)]
            weighed=node*(.45+.55*vx/fx)
            cost=(K*weighed+once)*fx*fy/(vx*vy)
            best[fx,fy]=cost
    square=min((c.mean(),f) for f,c in best.items() if f[0]==f[1])
    anyone=min((c.mean(),f) for f,c in best.items())
    # each place its own shape
    local=numpy.min(list(best.values()),axis=0).mean()
    loc_sq=numpy.min([c for f,c in best.items() if f[0]==f[1]],axis=0).mean()
    print('  best square',square,'best rectangle everywhere',anyone,'best square of each place',loc_sq,'best rectangle of each place',local)
