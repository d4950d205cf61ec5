"""A landscape of triangles and 24 closed balls before it, as .glb: make_landscape.py FILE.glb [POINTS ON A SIDE]; 660 points: 1,018,322 triangles."""
import json, struct, sys, numpy as np
n=int(sys.argv[2]) if len(sys.argv)>2 else 700
rng=np.random.default_rng(1)
x,z=np.meshgrid(np.linspace(-1,1,n),np.linspace(0,1,n))
X=x*(6+60*z); Z=-(8+92*z)
Y=-1.5+0.8*np.sin(X*.9)*np.cos(Z*.35)+.05*rng.standard_normal(X.shape)+ (z**2)*18*(.4+.6*np.sin(3*x+1)**2)
v=np.stack([X,Y,Z],-1).reshape(-1,3).astype(np.float32)
i=np.arange(n*n).reshape(n,n)
f=np.concatenate([np.stack([i[:-1,:-1],i[:-1,1:],i[1:,:-1]],-1).reshape(-1,3),np.stack([i[:-1,1:],i[1:,1:],i[1:,:-1]],-1).reshape(-1,3)]).astype(np.uint32)
def uv(rows=40,cols=80):
    th=np.linspace(0,np.pi,rows+1)[1:-1]; ph=np.arange(cols)*2*np.pi/cols
    p=np.stack([np.outer(np.sin(th),np.cos(ph)),np.outer(np.cos(th),np.ones(cols)),-np.outer(np.sin(th),np.sin(ph))],-1).reshape(-1,3)
    p=np.concatenate([p,[[0,1,0],[0,-1,0]]]); N,S=len(p)-2,len(p)-1
    t=[]
    for r in range(rows-2):
        a=r*cols+np.arange(cols); b=r*cols+(np.arange(cols)+1)%cols
        t+=[np.stack([a,a+cols,b],-1),np.stack([b,a+cols,b+cols],-1)]
    a=np.arange(cols);b=(a+1)%cols
    t+=[np.stack([np.full(cols,N),a,b],-1)]
    a=(rows-2)*cols+a;b=(rows-2)*cols+b
    t+=[np.stack([np.full(cols,S),b,a],-1)]
    return p.astype(np.float32),np.concatenate(t).astype(np.uint32)
shapes=[(v,f),uv()]
blob=b'';views=[];acc=[];ids=[]
for vv,ff in shapes:
    for d,ct,ty,c in((vv,5126,"VEC3",len(vv)),(ff.reshape(-1),5125,"SCALAR",ff.size)):
        b=d.tobytes();views.append({"buffer":0,"byteOffset":len(blob),"byteLength":len(b)});blob+=b
        a={"bufferView":len(views)-1,"componentType":ct,"count":c,"type":ty}
        if ty=="VEC3":a["min"]=d.min(0).tolist();a["max"]=d.max(0).tolist()
        acc.append(a)
    ids.append((len(acc)-2,len(acc)-1))
mats=[{"name":"ground","doubleSided":True,"pbrMetallicRoughness":{"baseColorFactor":[.3,.4,.2,1]}}]+[{"name":f"paint {k}","pbrMetallicRoughness":{"baseColorFactor":[*rng.uniform(.1,.9,3),1]}} for k in range(6)]
meshes=[{"primitives":[{"attributes":{"POSITION":ids[0][0]},"indices":ids[0][1],"material":0}]}]+[{"primitives":[{"attributes":{"POSITION":ids[1][0]},"indices":ids[1][1],"material":k+1}]} for k in range(6)]
nodes=[{"mesh":0,"name":"Ground"}]
for k in range(24):
    d=rng.uniform(8,60); nodes.append({"mesh":1+k%6,"name":f"Ball {k}","scale":[d*.02]*3,"translation":[rng.uniform(-.4,.4)*d,rng.uniform(-.2,.3)*d,-d]})
nodes.append({"camera":0,"name":"Cam"})
doc={"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":list(range(len(nodes)))}],"nodes":nodes,"meshes":meshes,"cameras":[{"type":"perspective","perspective":{"yfov":.5,"znear":.1}}],"materials":mats,"accessors":acc,"bufferViews":views,"buffers":[{"byteLength":len(blob)}]}
j=json.dumps(doc).encode();j+=b' '*(-len(j)%4);blob+=b'\0'*(-len(blob)%4)
open(sys.argv[1],'wb').write(struct.pack('<4sII',b'glTF',2,28+len(j)+len(blob))+struct.pack('<I4s',len(j),b'JSON')+j+struct.pack('<I4s',len(blob),b'BIN\0')+blob)
print(sum(len(ff)*(1 if k==0 else 24) for k,(vv,ff) in enumerate(shapes)))
