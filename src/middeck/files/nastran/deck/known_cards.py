"""Fields of the cards that are read, and the names of the other cards.

A format names the fields in their order, each as ``name:kind``: n a positive integer, i an integer, r a
real, g a grid (integer) or a real, c components (digits 1 to 6, or 0 for none), d some of them, t text, a
anything; ``-`` must be blank and ``*`` is not looked at. ``=`` gives the default of a blank field, or none; a
field without it is required. A last name with ``+`` takes all that follows. After MSC and NX Nastran, Quick
Reference Guides.
"""

from typing import Any, NamedTuple

REQUIRED = object()
_COORDINATES = "cid:n rid:i=0 " + " ".join(f"{point}{i}:r=0" for point in "abc" for i in "123")
_THREE_GRIDS = "cid:n g1:n g2:n g3:n cidb:n= g1b:n= g2b:n= g3b:n="
_FORCE = "sid:n g:n cid:i=0 f:r n1:r=0 n2:r=0 n3:r=0"
_BAR_ENDS = (
    "ga:n gb:n x1:g= x2:r= x3:r= offt:a= pa:i=0 pb:i=0 w1a:r=0 w2a:r=0 w3a:r=0 w1b:r=0 w2b:r=0 w3b:r=0"
)
# Loads of load sets that are no forces on grids; RFORCE and ACCEL depend on masses.
_OTHER_LOADS = """
PLOAD PLOAD2 PLOAD4 PLOADX1 SLOAD SPCD DEFORM RFORCE RFORCE1 ACCEL ACCEL1 QVOL TEMP TEMPD TEMPRB LSEQ
"""
OTHER_LOADS = tuple(_OTHER_LOADS.split())

FORMATS: dict[str, str] = {
    "GRID": "id:n cp:i= x1:r=0 x2:r=0 x3:r=0 cd:i= ps:c= seid:i=",
    "GRDSET": "- cp:i=0 - - - cd:i=0 ps:c= seid:i=0",
    "SPOINT": "+ids:a",
    **{f"CORD2{kind}": _COORDINATES for kind in "RCS"},
    **{f"CORD1{kind}": _THREE_GRIDS for kind in "RCS"},
    "CBAR": f"eid:n pid:n= {_BAR_ENDS}",
    "BAROR": "- pid:n= - - x1:g= x2:r= x3:r= offt:a=",
    "CBEAM": f"eid:n pid:n= {_BAR_ENDS} sa:i=0 sb:i=0",
    "BEAMOR": "- pid:n= - - x1:g= x2:r= x3:r= offt:a=",
    "CROD": "eid:n pid:n= ga:n gb:n",
    "CTUBE": "eid:n pid:n= ga:n gb:n",
    "CONROD": "eid:n ga:n gb:n mid:n a:r j:r=0 c:r=0 nsm:r=0",
    "PBAR": "pid:n mid:n a:r=0 i1:r=0 i2:r=0 j:r=0 nsm:r=0 - * * * * * * * * k1:r= k2:r= i12:r=0",
    "PBARL": "pid:n mid:n group:a= type:t - - - - +dims:a",
    "PBEAM": "pid:n mid:n a:r i1:r i2:r i12:r=0 j:r=0 nsm:r=0 +rest:a",
    "PBEAML": "pid:n mid:n group:a= type:t - - - - +dims:a",
    "PROD": "pid:n mid:n a:r j:r=0 c:r=0 nsm:r=0",
    "PTUBE": "pid:n mid:n od:r t:r= nsm:r=0 od2:r=",
    "MAT1": "mid:n e:r= g:r= nu:r= rho:r=0 a:r=0 tref:r=0 ge:r=0 st:r=0 sc:r=0 ss:r=0 mcsid:i=0",
    "CONM1": "eid:n g:n cid:i=0 " + " ".join(f"m{i}{j}:r=0" for i in range(1, 7) for j in range(1, i + 1)),
    "CONM2": "eid:n g:n cid:i=0 m:r=0 x1:r=0 x2:r=0 x3:r=0 - i11:r=0 i21:r=0 i22:r=0 i31:r=0 i32:r=0 i33:r=0",
    "CMASS1": "eid:n pid:n= g1:i=0 c1:i=0 g2:i=0 c2:i=0",
    "CMASS2": "eid:n m:r g1:i=0 c1:i=0 g2:i=0 c2:i=0",
    "PMASS": "pid:n m:r +rest:a",
    "CELAS1": "eid:n pid:n= g1:i=0 c1:i=0 g2:i=0 c2:i=0",
    "CELAS2": "eid:n k:r g1:i=0 c1:i=0 g2:i=0 c2:i=0 ge:r=0 s:r=0",
    "CMASS3": "eid:n pid:n= g1:i=0 g2:i=0",
    "CMASS4": "eid:n m:r g1:i=0 g2:i=0",
    "CELAS3": "eid:n pid:n= g1:i=0 g2:i=0",
    "CELAS4": "eid:n k:r g1:i=0 g2:i=0",
    "PELAS": "pid:n k:r ge:r=0 s:r=0",
    "CBUSH": "eid:n pid:n= ga:n gb:n= x1:g= x2:r= x3:r= cid:i= s:r=0.5 ocid:i=-1 s1:r= s2:r= s3:r=",
    "PBUSH": "pid:n +rest:a",
    "RBE2": "eid:n gn:n cm:d +gm:a",
    "RBE3": "eid:n - refgrid:n refc:d +rest:a",
    "RBAR": "eid:n ga:n gb:n cna:c= cnb:c= cma:c= cmb:c= alpha:r=0",
    "RBE1": "eid:n +rest:a",
    "MPC": "sid:n +terms:a",
    "MPCADD": "sid:n +sets:n",
    "SPC": "sid:n g1:n c1:c= d1:r=0 g2:n= c2:c= d2:r=0",
    "SPC1": "sid:n c:c= +grids:a",
    "SPCADD": "sid:n +sets:n",
    "SUPORT": "+pairs:i",
    "SUPORT1": "sid:n +pairs:i",
    "GRAV": "sid:n cid:i=0 a:r n1:r=0 n2:r=0 n3:r=0 mb:i=0",
    "FORCE": _FORCE,
    "MOMENT": _FORCE,
    **dict.fromkeys(("FORCE1", "MOMENT1"), "sid:n g:n f:r g1:n g2:n"),
    **dict.fromkeys(("FORCE2", "MOMENT2"), "sid:n g:n f:r g1:n g2:n g3:n g4:n"),
    "PLOAD1": "sid:n eid:n type:t scale:t x1:r p1:r x2:r= p2:r=",
    "LOAD": "sid:n s:r +rest:a",
    "DMIG": "name:t +rest:a",
    "PARAM": "name:t v1:a +rest:a",
    "EIGR": "sid:n method:t= f1:r= f2:r= +rest:a",
    "EIGRL": "sid:n v1:r= v2:r= nd:n= +rest:a",
    **dict.fromkeys(OTHER_LOADS, "sid:n +rest:a"),
    **dict.fromkeys(("ASET", "ASET1", "BSET", "BSET1", "QSET", "QSET1", "CSET", "CSET1"), "+rest:a"),
}
# Elements whose stiffness or mass would be left out: refused.
REDUCE = "reduce the part that they are in to a component (Craig-Bampton), or model it with bars"
_CONTINUA = """
CQUAD4 CQUAD8 CQUADR CTRIA3 CTRIA6 CTRIAR CSHEAR CQUAD CTRIAX CTRIAX6 CQUADX CHEXA CPENTA CTETRA CPYRAM
CPYRA CRAC2D CRAC3D CSHELL CPLSTS3 CPLSTS4 CTRAX3 CQUADX4
"""
CONTINUA = frozenset(_CONTINUA.split())
_NOT_YET = """
CBEND CGAP CWELD CFAST CSEAM CBUSH1D CBUSH2D
RROD RTRPLT RSPLINE RSSCON RJOINT GENEL SEBULK SECONCT CBEAM3 CONVM CAABSF CHACAB CHACBR
"""
NOT_YET = frozenset(_NOT_YET.split())
# Cards of superelements without which they would be elsewhere or joined otherwise, and what each does.
PLACING = {
    "SELOC": "it puts a superelement elsewhere",
    "SEMPLN": "it mirrors a superelement",
    "CSUPER": "it makes an image of a superelement",
    "SEBNDRY": "it says which grids of superelements are joined",
    "SEEXCLD": "it says which grids of superelements are not joined",
    "RELEASE": "it parts a superelement from the rest in some components",
}
PLACED = "give the superelement its grids where it stands, joined to grids there, and take the card out"
# Those that say which superelement something is in: an article is not divided.
DIVIDING = frozenset(("SESET", "SEELT", "SETREE"))
# Cards without a part in stiffness and mass of bars: loads, dynamics, output, design, properties of others.
_IDLE = """
DEBUG PARVEC
TABLED1 TABLED2 TABLED3 TABLED4 TABLEM1 TABLEM2 TABLEM3 TABLEM4 TABLES1 TABLEST TABRND1 TABRNDG TABDMP1
TABLEHT TABLEH1 TABLE3D TABLED5 TEMPP1 TEMPP3 TEMPB3 TEMPBC TEMPF DLOAD RLOAD1 RLOAD2 TLOAD1 TLOAD2
TLOAD3 ACSRCE DAREA DPHASE DELAY FREQ FREQ1 FREQ2 FREQ3 FREQ4 FREQ5 TSTEP TSTEPNL TSTEP1 EIGB EIGC EIGP
DESVAR DLINK DRESP1 DRESP2 DRESP3 DCONSTR DCONADD DEQATN DESOPT DOPTPRM DSCREEN DVPREL1 DVPREL2 DVMREL1
DVMREL2 DVCREL1 DVCREL2 DVGRID DTABLE DVSET DVBSHAP DVSHAP DTABLE2 SET1 SET2 SET3 SPCR DTI DMI DMIK DMIJ
DMIJI TIC TICD SECT GUST AEROS AERO AELIST AESTAT AESURF AELINK AEPARM AEFACT AEFORCE AEPRESS AESURFS
AECOMP CAERO1 CAERO2 CAERO3 CAERO4 CAERO5 PAERO1 PAERO2 PAERO3 PAERO4 PAERO5 SPLINE1 SPLINE2 SPLINE3
SPLINE4 SPLINE5 FLUTTER MKAERO1 MKAERO2 TRIM FLFACT DIVERG CHBDYE CHBDYG CHBDYP PHBDY QBDY1 QBDY2 QBDY3
QHBDY QVECT CONV PCONV RADBC RADM RADSET VIEW VIEW3D BCONP BLSEG BFRIC BCBODY BCTABLE BCPARA BCPROP
BSURF BSURFS BCTSET BCTPARM BGSET BGPARM NLPARM NLPCI NLPARMT MATT1 MATT2 MATT3 MATT8 MATT9 MAT2 MAT3
MAT4 MAT5 MAT8 MAT9 MAT10 MAT11 MATS1 MATHE MATHP MATEP MATF CREEP PSHELL PCOMP PCOMPG PSOLID PLSOLID
PSHEAR PLPLANE PDAMP PDAMPT PDAMP5 CDAMP1 CDAMP2 CDAMP3 CDAMP4 CDAMP5 PVISC PBUSH1D PBUSHT PELAST PGAP
PWELD PFAST PBEND PBRSECT PBMSECT PSEAM RANDPS RANDT1 RCROSS OUTPUT OUTRCV SESUP MODTRAK
ECHOON ECHOOFF TF NOLIN1 NOLIN2 NOLIN3 NOLIN4 EPOINT MDLPRM SWLDPRM POINT OMIT OMIT1 USET USET1 SEUSET
SEUSET1 SEQSET SEQSET1 SEBSET SEBSET1 SECSET SECSET1 PLOTEL PLOTEL4 PLOTEL6 MONPNT1 MONPNT2 MONPNT3
HYBDAMP DAMPING UXVEC CSSCHD ACMODL MATPOOL TOPVAR BEADVAR ROTORG RSPINR RSPINT RGYRO UNBALNC CVISC
PLOTEL3 ROTORD ROTHYBD ROTORAX CAMPBLL SEQGP NLCNTL NLCNTL2 NLCNTLG NLSTEP NLOPRM NLAUTO NLSTRAT NLADAPT
EBDSET EBDADD ATVFS ACCMETR SPLINE6 SPLINE7 SPLINEX SPLINRB AECOMPL AEQUAD4 AETRIA3 AESCALE PRESPT
PARVAL SPCOFF SPCOFF1 CBARAO BNDFIX BNDFIX1 BNDFREE BNDFRE1 CSUPEXT SUPAX NSM NSM1 NSML NSML1 NSMADD
"""
IDLE = frozenset(_IDLE.split()) | DIVIDING


class Field(NamedTuple):
    """A field of a format: ``kind`` as above; ``default`` is `REQUIRED` where a blank is refused."""

    name: str
    kind: str
    default: Any


class Format(NamedTuple):
    """The fields of a card, and the field that may repeat after them."""

    fields: tuple[Field, ...]
    rest: Field | None

    @property
    def names(self) -> list[str]:
        """All names in their order."""
        return [f.name for f in (*self.fields, self.rest) if f is not None]


def _field(text: str) -> Field:
    if text in ("-", "*"):
        return Field("", text, None)
    name, _, kind = text.partition(":")
    kind, default, given = kind.partition("=")
    value = REQUIRED if not default else None
    if given:
        value = float(given) if kind == "r" else int(given)
    return Field(name, kind, value)


def _format(text: str) -> Format:
    *fields, last = map(_field, text.split())
    if last.name.startswith("+"):
        return Format(tuple(fields), Field(last.name[1:], last.kind, None))
    return Format((*fields, last), None)


PARSED = {name: _format(text) for name, text in FORMATS.items()}
# The place of each field among its card's values.
PLACES = {name: {field: i for i, field in enumerate(f.names)} for name, f in PARSED.items()}
