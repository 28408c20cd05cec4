"""Query with SPARQL, assert a statement, ask a question that uses it, and retract it."""

from mindstage import KnowledgeBase

QUERY = "SELECT ?mug { ?mug a ms:CoffeeMug } ORDER BY ?mug"

with KnowledgeBase() as kb:
    kb.load("bundled:kitchen")
    for mug in kb.sparql(QUERY)["mug"]:
        print(mug.value)

    kb.tell("CookieJar", "typePrimaryFunction-containerFor", "Candy")
    print(*kb.ask("storage_place", item="Candy"))
    kb.retract("CookieJar", "typePrimaryFunction-containerFor", "Candy")
    print(kb.ask("storage_place", item="Candy"))
